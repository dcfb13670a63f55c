"""What torch.compile is to leave alone. (A decorator of torch's that loads its compiler: apart.)"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import torch


@torch.compiler.disable  # type: ignore[untyped-decorator]
def apart(run: Callable[[Any], Any], given: Any) -> Any:
    """`run(given)`, outside what is being compiled."""
    return run(given)
