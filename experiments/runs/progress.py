"""A bar for what takes a while."""

import sys

from tqdm import tqdm


def progress_bar(total: int, unit: str) -> tqdm:
    """A bar on stderr for what takes over 2 s; a line now and then where that is no terminal."""
    often = 0.2 if sys.stderr.isatty() else 10.0
    return tqdm(total=total, unit=unit, delay=2.0, mininterval=often, leave=False)
