"""The command line: ``python -m sins_env`` does the same as ``sins-env``."""

import sys

from sins_env.cli.main import main

if __name__ == "__main__":
    sys.exit(main())
