"""Tables and figures: results as terminal, Markdown, CSV, JSON and PNG.

The results of ``score`` come in; text or a Matplotlib figure goes out. All tables iterate over the one list of columns.
Read ``numbers``, ``cells``, ``columns``, ``plain_tables``, ``rich_tables``, ``terminal_tables``, ``footer``, then ``style``,
``error_figure``, ``drawn_results``, ``run_figure``, ``bank_figure``.
``templates`` serves the HTML report and the reproduction paper.
"""
