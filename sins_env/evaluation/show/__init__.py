"""Scores become tables and figures: terminal, Markdown, CSV, JSON and PNG.

Read ``numbers``, ``columns``, ``plain_tables``, ``terminal_tables``, ``footer``, then ``style``, ``error_figure``, ``run_figure``.
"""
