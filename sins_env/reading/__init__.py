"""Files and texts of others, each bounded in bytes, depth and time before it is expanded.

The path of a file or a text comes in. Plain values, arrays or an open stream go out, or one ValueError that says where,
what was found and what is allowed. Read ``files``, then ``documents`` (JSON and YAML), ``datasheets`` (sensors),
``archives`` (NPZ) and ``matlab``.
"""
