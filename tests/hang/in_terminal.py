"""The command line with the terminal as its own, which a shell would arrange: `python -m` this module, then its words."""

import fcntl
import os
import sys
import termios

from servobench.cli import main

if __name__ == "__main__":
    fcntl.ioctl(0, termios.TIOCSCTTY, 0)
    os.tcsetpgrp(0, os.getpgrp())
    sys.exit(main())
