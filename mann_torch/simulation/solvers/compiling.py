"""torch.compile where a C++ compiler is found, eager PyTorch where none is.

`torch._dynamo` takes a second to import, and is only where something is compiled by it.
"""

from __future__ import annotations

import logging
from collections.abc import Callable
from typing import Any

import torch

log = logging.getLogger("mann_torch")


class CompiledOrEager:
    """Calls `torch.compile(function)`; if compiling fails, `function` from then on.

    `engine` is ``torch.compile`` or ``eager``: what the last call used. The fallback is logged in
    one line, with the cause.
    """

    def __init__(self, function: Callable[..., Any]) -> None:
        from torch._dynamo import config

        # All rollouts of a process share one count of compiled shapes; 8 is too few for that.
        config.recompile_limit = max(config.recompile_limit, 256)
        self._function = function
        self._compiled = torch.compile(function, fullgraph=True)
        self._proven = False
        self.engine = "torch.compile"

    def __call__(self, *args: Any) -> Any:
        if self.engine == "eager":
            return self._function(*args)
        try:
            result = self._compiled(*args)
        except Exception as error:  # torch raises many kinds here, none of them documented
            from torch._dynamo.exc import TorchDynamoException

            if self._proven and not isinstance(error, TorchDynamoException):
                raise
            cause = str(error).strip().splitlines()[0] if str(error).strip() else "no message"
            log.warning(
                "torch.compile failed (%s: %s); using eager PyTorch", type(error).__name__, cause
            )
            self.engine = "eager"
            return self._function(*args)
        self._proven = True
        return result
