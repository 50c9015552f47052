"""The verbs of the command line, a function each; small verbs of one subject share a file."""
