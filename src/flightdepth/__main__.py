"""`python -m flightdepth`, and so `accelerate launch -m flightdepth`: the command line."""

import sys

from flightdepth.cli import main

if __name__ == "__main__":
    sys.exit(main())
