"""Tables of numbers in text files, as instruments and spreadsheets write them.

A path and a :class:`Style` come in: comment marks, delimiter, decimal mark, header, lines to skip. What the style leaves
open is measured on the first lines. A :class:`Table` of finite numbers goes out, or one error with line and column.
The text passes through in blocks of a megabyte, so that a large file needs memory for its numbers only.

Read ``style``, ``head``, ``dates``, ``table``, ``writing``.
"""

from sins_env.recordings.text.head import Head, read_head
from sins_env.recordings.text.style import Style
from sins_env.recordings.text.table import Table, header, read_table
from sins_env.recordings.text.writing import write_files, write_rows

__all__ = ["Head", "Style", "Table", "header", "read_head", "read_table", "write_files", "write_rows"]
