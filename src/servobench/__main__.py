"""`python -m servobench`: the same as the command `servobench`."""

import sys

from servobench.cli import main

if __name__ == "__main__":
    sys.exit(main())
