"""A lagging actuator solved with the plant: a short lag under a stiff loop is stiff too."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import torch
from torch import Tensor

from ..stiff import StiffBlock
from ..types import InputGains


class Lag(NamedTuple):
    """How fast an actuator's output a answers: d(da/dt) = pull (du - da)."""

    pull: Tensor  # (..., m) [1/s], 0 where the rate is at its limit
    gains: InputGains | None  # of u, the command within its limits


class LaggedBlock(NamedTuple):
    """Of plant and actuator: d(dx/dt) = A dx + B da, d(da/dt) = pull (drift dt - K dx - da).

    The actuator's numbers lie before those of the reference model, which are the last. B and K come
    of the plant's own blocks, each with one input's gains alone, A - B_i K_i, whose drift is B_i:
    so that any plant's form of a block will do. Without a block of the plant's A = B = 0, which
    leaves the lag's own pole.
    """

    alone: StiffBlock | None  # of the plant, its input held
    each: StiffBlock | None  # (..., m, *) with one input's gains
    pull: Tensor  # (..., m)
    drift: Tensor  # (..., m)
    behind: Tensor | None  # (..., d) of the reference model

    def damped(self, rate: Tensor, gh: Tensor, sign: float) -> Tensor:
        """(I - g h A)^-1 (rate + sign g h T), (..., M); gh is (..., 1).

        With w = gh pull, (1 + w) k_a = f_a - w K k_x is put into the plant's rows:
        (I - gh A + gh B w/(1 + w) K) k_x = f_x + gh B f_a / (1 + w).
        """
        end = rate.shape[-1] - (0 if self.behind is None else self.behind.shape[-1])
        begin = end - self.pull.shape[-1]
        w, f_a = gh * self.pull, rate[..., begin:end]
        if sign:
            f_a = f_a + sign * w * self.drift
        k_a, share, solved = f_a / (1.0 + w), w / (1.0 + w), rate
        if self.alone is not None and self.each is not None:
            columns = self.each.drift  # (..., m, .) B_i
            push = (k_a.unsqueeze(-2) @ columns).squeeze(-2)
            solved = _mixed(self.alone, self.each, share, push).damped(rate, gh, 1.0)
            moved = self.each.answer(solved.unsqueeze(-2))
            moved = moved - self.alone.answer(solved).unsqueeze(-2)  # -B_i K_i k_x
            square = columns.square().sum(dim=-1)
            reached = square > 0
            along = (columns * moved).sum(dim=-1) / torch.where(reached, square, 1.0)
            k_a = k_a + share * torch.where(reached, along, 0.0)
        elif self.alone is not None:
            solved = self.alone.damped(rate, gh, 0.0)
        return torch.cat([solved[..., :begin], k_a, solved[..., end:]], dim=-1)


def _mixed(
    alone: StiffBlock,
    each: StiffBlock,
    share: Tensor,
    push: Tensor,
) -> StiffBlock:
    """The plant's block with a share (..., m) of each input's gains."""
    wide = share.unsqueeze(-1).unsqueeze(-1)
    parts = [
        matrix + (wide * (single - matrix.unsqueeze(-3))).sum(dim=-3)
        for matrix, single in zip(alone[:-1], each[:-1], strict=True)
    ]
    kind: Any = type(alone)
    mixed: StiffBlock = kind(*parts, push)
    return mixed


AnyBlock = StiffBlock | LaggedBlock


def lagged(
    linearized: Callable[[InputGains | None], tuple[Any, StiffBlock | None]],
    lag: Lag,
    behind: Tensor | None,
) -> tuple[Any, LaggedBlock]:
    """The plant's rate and the block, of its `linearized` as a function of the gains."""
    m, gains = lag.pull.shape[-1], lag.gains
    if gains is None:
        rate, alone = linearized(None)
        return rate, LaggedBlock(alone, None, lag.pull, torch.zeros_like(lag.pull), behind)
    rate, alone = linearized(InputGains(*map(torch.zeros_like, gains)))
    each = None
    if alone is not None:
        rows = torch.eye(m, dtype=lag.pull.dtype).unbind(0)
        singles = [
            linearized(InputGains(gains.measurement * row.unsqueeze(-1), row.expand_as(lag.pull)))
            for row in rows
        ]
        # Rows of `drift` are one number less deep than matrices.
        *matrices, drifts = zip(*(block for _, block in singles if block), strict=True)
        stacks = [torch.stack(matrix, dim=-3) for matrix in matrices]
        kind: Any = type(alone)
        each = kind(*stacks, torch.stack(drifts, dim=-2))
    return rate, LaggedBlock(alone, each, lag.pull, gains.drift, behind)
