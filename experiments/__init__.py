"""Commands around the library: `python -m experiments.simulate` and its like."""

import os
import signal
import sys
from types import FrameType


def _interrupted(number: int, frame: FrameType | None) -> None:
    """Ctrl-C before anything is begun: one line, as later.

    No exception: what is being imported may catch it, and the command would go on.
    """
    os.write(2, b"error: interrupted before anything was begun\n")
    os._exit(130)


# Python has no name for the program yet where it is started as a module of this package.
_AS_COMMAND = sys.argv[0] == "-m" or os.path.basename(sys.argv[0]).startswith("mann-")
if _AS_COMMAND and signal.getsignal(signal.SIGINT) is signal.default_int_handler:
    signal.signal(signal.SIGINT, _interrupted)
