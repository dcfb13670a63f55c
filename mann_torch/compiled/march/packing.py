"""Samples side by side: from rows (B, n) to groups of lanes, and back."""

from __future__ import annotations

import torch
from torch import Tensor

from ..host.kernels import lanes_here
from .program import Program

#: Bytes of working memory that one core may use before a group gets fewer lanes.
ROOM = 2**30


def lanes_for(program: Program, batch: int, threads: int, device: str = "cpu") -> int:
    """Lanes to a group: as many as the machine has, one where cores alone serve the batch.

    Fewer where the working memory of a step would be too large; one on a GPU, whose threads are
    lanes.
    """
    lanes = 1 if batch <= 2 * threads or device != "cpu" else lanes_here()
    return 1 if 8 * lanes * program.forward(lanes).heap > ROOM else lanes


def to_lanes(x: Tensor, lanes: int) -> Tensor:
    """(..., B, n) -> (..., G, n, L), the last sample again where lanes are left over."""
    batch = x.shape[-2]
    groups = -(-batch // lanes)
    if groups * lanes != batch:
        last = x[..., -1:, :].expand(*x.shape[:-2], groups * lanes - batch, x.shape[-1])
        x = torch.cat([x, last], dim=-2)
    x = x.unflatten(-2, (groups, lanes))
    return x.mT.contiguous()


def from_lanes(x: Tensor, batch: int) -> Tensor:
    """The inverse of `to_lanes`."""
    return x.mT.flatten(-3, -2)[..., :batch, :]


def padded(row: Tensor, count: int) -> Tensor:
    """A number a sample (B,), the last again for lanes that are left over; empty stays empty."""
    if len(row) in (0, count):
        return row
    return torch.cat([row, row[-1:].expand(count - len(row))])
