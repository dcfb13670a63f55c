"""Commands around the library: `python -m experiments.simulate` and its like."""

import os
import sys
from types import TracebackType


def _interrupted(
    kind: type[BaseException], error: BaseException, trace: TracebackType | None
) -> None:
    """Ctrl-C while a command is still being imported: one line, as later."""
    if not issubclass(kind, KeyboardInterrupt):
        sys.__excepthook__(kind, error, trace)
        return
    sys.stderr.write("error: interrupted before anything was begun\n")
    sys.stderr.flush()
    os._exit(130)


# Python has no name for the program yet where it is started as a module of this package.
if sys.argv[0] == "-m" or os.path.basename(sys.argv[0]).startswith("mann-"):
    sys.excepthook = _interrupted
