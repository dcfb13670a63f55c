"""Memory that one march after another works in: fresh pages cost more than what is done in them."""

from __future__ import annotations

import math
import threading
import weakref
from collections.abc import Sequence

import torch
from torch import Tensor

#: Bytes that are kept for the next march; a buffer of less is not worth it.
MOST, LEAST = 2**27, 2**16


class Rooms:
    """Buffers lent to marches, and given back when a march is forgotten."""

    def __init__(self) -> None:
        self._free: list[Tensor] = []
        self._lock = threading.Lock()

    def lend(self, owner: object, shape: Sequence[int], dtype: torch.dtype) -> Tensor:
        """A tensor of whatever numbers, for as long as its owner lives. It must not outlive it."""
        size = math.prod(shape) * dtype.itemsize
        if size < LEAST:
            return torch.empty(tuple(shape), dtype=dtype)
        with self._lock:
            fits = [i for i, x in enumerate(self._free) if size <= len(x) <= 2 * size]
            best = min(fits, key=lambda i: len(self._free[i]), default=None)
            room = None if best is None else self._free.pop(best)
        if room is None:
            with torch.inference_mode(False):
                room = torch.empty(size, dtype=torch.uint8)
        weakref.finalize(owner, self._give_back, room).atexit = False
        return room[:size].view(dtype).reshape(tuple(shape))

    def _give_back(self, room: Tensor) -> None:
        with self._lock:
            self._free.append(room)
            while sum(map(len, self._free)) > MOST:
                self._free.pop(0)


ROOMS = Rooms()
