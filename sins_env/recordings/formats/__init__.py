"""One module per file format. Each reads a file into a :class:`sins_env.recordings.Recording`, and some write one."""
