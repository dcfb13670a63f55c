"""Concurrent learning."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Literal, NamedTuple

import torch
from torch import Tensor

from ...checks import NONNEGATIVE, POSITIVE, choice, number, whole
from ...constraints import Finite
from ...errors import ConfigError, ShapeError
from ...functional import Numbers, as_float64, one_hot, per_matrix
from ...trees import portable
from ..timing import TIE, due, running, started
from .composite import measured
from .drive import Drive
from .part import Term


@portable
class Watch(NamedTuple):
    """What recording keeps."""

    elapsed: Tensor  # (...,) [s]


@portable
class Stack(NamedTuple):
    """Recorded pairs, 0 where there is none yet."""

    regressors: Tensor  # (..., K, N, r)
    labels: Tensor  # (..., K, r, m)
    taken: Tensor  # (...,) int64, recorded so far


class ConcurrentLearning(Term):
    """+ Gamma g Sum_k Phi_k (y_k - Phi_k' theta), over a stack of `size` recorded pairs.

    `learning_gain` g is a constant. A pair of `rows` r is recorded every `period` [s], the first at
    `first` [s], a multiple of the period and itself a period if not given. When the stack is full
    it `keeps` the "first" ones, or goes round and replaces the oldest ("cycle"). A frozen stack,
    `points` (K, N) and `labels` (K, m), records nothing and needs no pair. Chowdhary and Johnson
    2010, Concurrent learning for convergence in adaptive control without persistency of excitation.
    Raises `ConfigError`, `ShapeError`, `DomainError`, `KindError` or `DtypeError`.
    """

    points: Tensor | None
    labels: Tensor | None

    def __init__(
        self,
        learning_gain: Numbers = 0.0,
        size: int = 20,
        period: float = 0.5,
        first: float | None = None,
        keeps: Literal["first", "cycle"] = "first",
        rows: int = 1,
        points: Numbers | None = None,
        labels: Numbers | None = None,
    ) -> None:
        super().__init__()
        self.learning_gain: Tensor
        self.declare_rows("learning_gain", learning_gain)
        self.size, self._rows = whole("size", size), whole("rows", rows)
        self.period = number("period", period, POSITIVE)
        self.first = self.period if first is None else number("first", first, NONNEGATIVE)
        if abs(self.first / self.period - round(self.first / self.period)) > TIE:
            raise ConfigError(f"first = {first}: give a multiple of period = {period}")
        self.keeps = choice("keeps", keeps, ("first", "cycle"))
        if (points is None) != (labels is None):
            raise ConfigError("give points and labels, for a frozen stack, or neither")
        frozen = [None if rows is None else Finite().check(name, as_float64(rows, name))
                  for name, rows in (("points", points), ("labels", labels))]  # fmt: skip
        shapes = [tuple(x.shape) for x in frozen if x is not None]
        if shapes and not (len(shapes[0]) == len(shapes[1]) == 2 and shapes[0][0] == shapes[1][0]):
            raise ShapeError(f"points {shapes[0]} and labels {shapes[1]}: not (K, N) and (K, m)")
        self.register_buffer("points", frozen[0])
        self.register_buffer("labels", frozen[1])

    @property
    def needs(self) -> frozenset[str]:
        """The pair, where it records."""
        return frozenset({"pair"}) if self.points is None else frozenset()

    @property
    def drives(self) -> bool:
        """True: by what the stack's labels miss."""
        return True

    @property
    def rows(self) -> int | None:
        """Of a pair, where it records."""
        return self._rows if self.points is None else None

    @property
    def periods(self) -> tuple[float, ...]:
        """Of recording."""
        return (self.period,) if self.points is None else ()

    def initial_state(self, n_features: int, n_outputs: int, batch_shape: Sequence[int]) -> Any:
        """The watch."""
        return Watch(started(batch_shape)[0]) if self.points is None else None

    def initial_mode(self, n_features: int, n_outputs: int, batch_shape: Sequence[int]) -> Any:
        """An empty stack. Raises `ShapeError` where a frozen one does not fit."""
        if self.points is not None and self.labels is not None:
            found = (self.points.shape[-1], self.labels.shape[-1])
            if found[0] != n_features or found[1] not in (1, n_outputs):
                raise ShapeError(f"a stack of (N, m) = {found} among {(n_features, n_outputs)}")
            return None
        stack = (*batch_shape, self.size)
        return Stack(
            torch.zeros(*stack, n_features, self._rows, dtype=torch.float64),
            torch.zeros(*stack, self._rows, n_outputs, dtype=torch.float64),
            started(batch_shape)[1],
        )

    def forward(self, drive: Drive, estimate: Tensor, state: Any, mode: Any) -> tuple[Tensor, Any]:
        """g Sum_k Phi_k (y_k - Phi_k' theta) (..., N, m), and the watch's rate."""
        if self.points is not None and self.labels is not None:
            pushed = self.points.mT @ (self.labels - self.points @ estimate)
            return self.per_estimate("learning_gain") * pushed, None
        missed = mode.labels - mode.regressors.mT @ estimate.unsqueeze(-3)
        pushed = (mode.regressors @ missed).sum(dim=-3)
        return self.per_estimate("learning_gain") * pushed, Watch(running(state.elapsed))

    def jump(self, drive: Drive, estimate: Tensor, state: Any, mode: Any) -> tuple[Any, Any]:
        """The pair of this instant put on the stack, where it is due."""
        if self.points is not None:
            return state, mode
        pair = measured(drive)
        now = due(state.elapsed, mode.taken, self.period, self.first)
        if self.keeps == "first":
            now = now & (mode.taken < self.size)
        here = one_hot(torch.remainder(mode.taken, self.size), self.size) & now.unsqueeze(-1)
        here = per_matrix(here)
        return state, Stack(
            torch.where(here, pair.regressor.unsqueeze(-3), mode.regressors),
            torch.where(here, pair.label.unsqueeze(-3), mode.labels),
            mode.taken + now.to(mode.taken.dtype),
        )
