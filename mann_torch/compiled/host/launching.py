"""Launches of a compiled kernel on the CPU without Warp's bookkeeping: its function, by ctypes.

A recorded launch of Warp packs its arguments anew each time, some tens of microseconds. Here they
are packed once and two numbers of them changed. Where Warp is built otherwise than it was when this
was written, `direct` is None, and its own launches serve.
"""

from __future__ import annotations

import ctypes
import functools
from collections.abc import Callable
from typing import Any, NamedTuple

import torch
from torch import Tensor


class Direct(NamedTuple):
    """A function of the addresses of bounds and arguments, and both for some launch of it."""

    function: Any
    bounds: Any
    arguments: Any
    command: Any  # it keeps the code loaded

    def with_table(self, table: Tensor, offset: int) -> Any:
        """Arguments of a launch of its own."""
        own = type(self.arguments).from_buffer_copy(self.arguments)
        own.pointers.data = table.data_ptr()
        own.offset = offset
        own.table = table  # it lives as long
        return own


def recorded(made: Any, table: Tensor, offset: int, count: int, device: str) -> Any:
    """Warp's own launch over `count` groups."""
    import warp as wp

    given = [wp.from_torch(table, dtype=wp.int64), offset, 0, 0]
    return wp.launch(made, dim=count, inputs=given, device=device, record_cmd=True)


@functools.lru_cache(maxsize=512)
def direct(made: Any, count: int) -> Direct | None:
    """How a kernel is launched over `count` groups."""
    try:
        command = recorded(made, torch.zeros(64, dtype=torch.int64), 0, count, "cpu")
        bounds, *given = command.params
        names = [a.label for a in made.adj.args]
        fields = [(n, type(x)) for n, x in zip(names, given, strict=True)]
        made_of = type("Arguments", (ctypes.Structure,), {"_fields_": fields})
        function = command.hooks.forward
        fits = names == ["pointers", "offset", "first", "last"] and command.block_dim == 1
        if not fits or not callable(function):
            return None
        arguments = made_of(*given)
        if not hasattr(arguments.pointers, "data"):
            return None
        return Direct(function, bounds, arguments, command)
    except (AttributeError, TypeError, ValueError):
        return None


def launch(found: Direct, table: Tensor, offset: int) -> Callable[[int, int], None]:
    """What runs ranges of steps."""
    own = found.with_table(table, offset)
    function, given = found.function, (ctypes.byref(found.bounds), ctypes.byref(own))

    def run(first: int, last: int) -> None:
        own.first, own.last = first, last
        function(*given)

    return run


def single(found: Direct, table: Tensor) -> Callable[[], Any]:
    """What runs the first step of the first group, and nothing else."""
    own = found.with_table(table, 0)
    own.first, own.last = 0, 1
    given = (ctypes.byref(found.bounds), ctypes.byref(own))
    return functools.partial(found.function, *given)
