"""How a command is called: as the user called this one."""

from __future__ import annotations

import shlex
import sys
from pathlib import Path

#: What installed commands begin with: `mann-simulate`.
_INSTALLED = "mann-"


def as_started(command: str) -> list[str]:
    """The words that start a command, as those which started this process did."""
    if Path(sys.argv[0]).name.startswith(_INSTALLED):
        return [_INSTALLED + command.replace("_", "-")]
    return ["python", "-m", f"{__package__.rpartition('.')[0]}.{command}"]


def arguments_of(command: str) -> list[str]:
    """What follows these words in a command line."""
    words = shlex.split(command)
    return words[1 if words[0].startswith(_INSTALLED) else 3 :]
