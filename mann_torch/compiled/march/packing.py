"""Samples side by side: from rows (B, n) to groups of lanes, and back."""

from __future__ import annotations

import torch
from torch import Tensor

from ..host.kernels import lanes_here
from .loop_text import FINE
from .program import Program

#: Bytes that a core works on, beyond which a group gets one lane: more at once is slower.
ROOM = 2**28


def lanes_for(program: Program, batch: int, threads: int, device: str = "cpu") -> int:
    """Lanes to a group: as many as the machine has, one where cores alone serve the batch.

    One where the working memory of steps and their gradients would be too large, and on a GPU,
    whose threads are lanes.
    """
    real = program.layout.real
    lanes = 1 if batch <= 2 * threads or device != "cpu" else lanes_here(real.bytes)
    state = program.layout.size("f") + program.layout.size("k")
    room = real.bytes * lanes * (program.forward(lanes).heap + (FINE + 3) * state)
    return lanes if room <= ROOM else 1


def to_lanes(x: Tensor, lanes: int) -> Tensor:
    """(..., B, n) -> (..., G, n, L), a copy; the last sample again where lanes are left over."""
    batch = x.shape[-2]
    groups = -(-batch // lanes)
    if groups * lanes != batch:
        last = x[..., -1:, :].expand(*x.shape[:-2], groups * lanes - batch, x.shape[-1])
        x = torch.cat([x, last], dim=-2)
    x = x.unflatten(-2, (groups, lanes))
    return x.mT.clone(memory_format=torch.contiguous_format)


def from_lanes(x: Tensor, batch: int) -> Tensor:
    """The inverse of `to_lanes`."""
    return x.mT.flatten(-3, -2)[..., :batch, :]


def padded(row: Tensor, count: int) -> Tensor:
    """A number a sample (B,), the last again for lanes that are left over; empty stays empty."""
    if len(row) in (0, count):
        return row
    return torch.cat([row, row[-1:].expand(count - len(row))])
