"""The command line as ``python -m coopmm_jax``."""

import sys

from coopmm_jax.cli import main

if __name__ == "__main__":
    sys.exit(main())
