"""`python -m ngbrain`."""

import sys

from ngbrain.cli import main

if __name__ == "__main__":
    sys.exit(main())
