"""The HTML report: one self-contained page of tables and figures.

A results file of ``store`` comes in; the text of the page goes out. Tables have the columns of ``show``.
Read ``page`` with the template ``page.html.j2``, then ``page_tables``, ``page_figures``, ``panel``, ``svg``.
"""

from sins_env import moved

#: In version 0.1.0 this was a module; its names are found here still.
__getattr__ = moved.forward(__name__, ("sins_env.evaluation.report.page",))
