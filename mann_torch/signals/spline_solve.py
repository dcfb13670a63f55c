"""Slopes of a spline at its samples: those of the least bending, or of the least jerk.

Between samples of distance h a spline of degree 2m - 1 is the polynomial with given value and
m - 1 derivatives at both ends, and of all such functions it has the least integral of the square
of derivative m. That integral is a quadratic form of what the ends are; it has its least value
where its derivative by the unknown slopes is 0 (the stiffness equations of a beam, m = 2).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import torch
from torch import Tensor

from ..functional import solve_small


class Stiffness(NamedTuple):
    """The quadratic form of one piece of length 1, by the slopes at its ends.

    Matrices ((m - 1) x (m - 1)) of the slopes at start and end, and what a drop from the value at
    the start to that at the end gives each.
    """

    start: Sequence[Sequence[float]]
    across: Sequence[Sequence[float]]
    end: Sequence[Sequence[float]]
    drop_start: Sequence[float]
    drop_end: Sequence[float]


STIFFNESS: dict[int, Stiffness] = {
    3: Stiffness([[4.0]], [[2.0]], [[4.0]], [6.0], [6.0]),
    5: Stiffness(
        [[192.0, 36.0], [36.0, 9.0]],
        [[168.0, -24.0], [24.0, -3.0]],
        [[192.0, -36.0], [-36.0, 9.0]],
        [360.0, 60.0],
        [360.0, -60.0],
    ),
}


def slopes(times: Tensor, values: Tensor, degree: int, ends: Tensor | None) -> Tensor:
    """Derivatives 1 to m - 1 at each sample: (..., K, m - 1, p).

    Times (..., K), values (..., K, p); `ends` (..., 2, m - 1, p) are those at the first and the
    last sample, None leaves them free (natural).
    """
    form, unknowns = STIFFNESS[degree], (degree - 1) // 2
    length = torch.diff(times, dim=-1)[..., None, None]
    order = torch.arange(1, unknowns + 1, dtype=times.dtype)
    column = length ** order.unsqueeze(-1)  # a derivative's unit, from shares of a piece to time
    outer = column * column.mT / length**degree
    load = column / length**degree
    start, across, end = (outer * values.new_tensor(m) for m in form[:3])
    drop = -torch.diff(values, dim=-2).unsqueeze(-2)
    pull_start = load * values.new_tensor(form.drop_start).unsqueeze(-1) * drop
    pull_end = load * values.new_tensor(form.drop_end).unsqueeze(-1) * drop
    none, still = torch.zeros_like(start[..., :1, :, :]), torch.zeros_like(drop[..., :1, :, :])
    still = still.expand(*still.shape[:-2], unknowns, -1)
    diagonal = torch.cat([start, none], dim=-3) + torch.cat([none, end], dim=-3)
    right = -torch.cat([pull_start, still], dim=-3) - torch.cat([still, pull_end], dim=-3)
    below, above = list(across.mT.unbind(-3)), list(across.unbind(-3))
    middle, wanted = list(diagonal.unbind(-3)), list(right.unbind(-3))
    if ends is not None:
        unit, nothing = torch.eye(unknowns, dtype=times.dtype), torch.zeros_like(middle[0])
        middle[0] = middle[-1] = unit + nothing
        above[0], below[-1] = nothing, nothing
        wanted[0], wanted[-1] = ends[..., 0, :, :], ends[..., 1, :, :]
    return _swept(below, middle, above, wanted)


def _swept(
    below: list[Tensor], middle: list[Tensor], above: list[Tensor], right: list[Tensor]
) -> Tensor:
    """Solution (..., K, m, p) of a block tridiagonal system, by elimination from the first row."""
    carried: list[Tensor] = []
    reduced: list[Tensor] = []
    for k, pivot in enumerate(middle):
        wanted = right[k]
        if k:
            pivot = pivot - below[k - 1] @ carried[-1]
            wanted = wanted - below[k - 1] @ reduced[-1]
        if k < len(above):
            carried.append(solve_small(pivot, above[k]))
        reduced.append(solve_small(pivot, wanted))
    found = [reduced[-1]]
    for k in reversed(range(len(above))):
        found.append(reduced[k] - carried[k] @ found[-1])
    return torch.stack(found[::-1], dim=-3)
