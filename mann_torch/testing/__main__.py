"""`python -m mann_torch.testing`: does the library work here? Exit code 1 where it does not."""

import sys

from .self_check import run

if __name__ == "__main__":
    sys.exit(1 if run(lambda line: print(line, flush=True)) else 0)
