"""What the package writes for others: text that steers nothing, and files that appear whole or not at all.

Text of any origin comes in; text for a terminal, a page, Markdown, CSV or JSON goes out. Read ``visible``, ``plain``,
``files``.
"""
