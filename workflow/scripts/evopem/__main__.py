"""``python -m evopem``: the command ``evopem``."""

import sys

from evopem.terminal.command import main

if __name__ == "__main__":
    sys.exit(main())
