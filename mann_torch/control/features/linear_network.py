"""A network that is linear in its weights, which any law moves."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import torch
from torch import Tensor

from ...checks import instance, sizes, whole
from ...domains import Finite
from ...errors import ConfigError, ShapeError
from ...functional import Numbers, as_float64, frobenius, row_times, times_column
from ...trees import portable
from ...types import Features
from ..laws import AdaptiveLaw, ConstantGain, Drive, Law
from .basis import Basis
from .feature_network import FeatureNetwork


@portable
class LinearWeights(NamedTuple):
    """Weights of features that do not move."""

    W: Tensor  # (..., N, m)


class LinearNetwork(FeatureNetwork):
    """f^ = W' phi(z): features of a `Basis`, and weights W (N, m) that a law moves.

    `law` is d W/dt = 10 phi s' if none is given. `start` is W at t = 0, 0 if not given: (N, m), or
    one number for all. Raises `ShapeError`, `ConfigError`, `DomainError`, `KindError` or
    `DtypeError`.
    """

    outer = ("W",)

    def __init__(
        self,
        basis: Basis,
        n_outputs: int,
        law: Law | None = None,
        start: Numbers = 0.0,
    ) -> None:
        super().__init__()
        self.basis = instance("basis", basis, Basis)
        self.n_inputs, self.n_hidden = basis.n_inputs, basis.n_features
        self.n_outputs = whole("n_outputs", n_outputs)
        law = AdaptiveLaw(ConstantGain(10.0)) if law is None else law
        self.law = instance("law", law, Law)
        rows = Finite().check("start", as_float64(start, "start").detach())
        shape = (self.n_hidden, self.n_outputs)
        if rows.dim() and rows.shape != shape:
            raise ShapeError(f"start of shape {tuple(rows.shape)}: give {shape}, or one number")
        self.start: Tensor
        self.register_buffer("start", rows.expand(shape).clone())

    @property
    def laws(self) -> tuple[Law, ...]:
        """One."""
        return (self.law,)

    def initial_state(
        self, batch_shape: Sequence[int], generator: torch.Generator | None = None
    ) -> LinearWeights:
        """`start` (..., N, m); nothing is random."""
        batch = sizes("batch_shape", batch_shape)
        return LinearWeights(self.start.expand(*batch, *self.start.shape))

    def initial_laws(self, batch_shape: Sequence[int]) -> tuple[Any, Any]:
        """Of its law."""
        given = (self.n_hidden, self.n_outputs, batch_shape)
        return self.law.initial_state(*given), self.law.initial_mode(*given)

    def check_state(self, state: LinearWeights) -> torch.Size:
        """Batch shape of weights. Raises `ShapeError`, `ConfigError`, `KindError`, `DtypeError`."""
        W = as_float64(instance("W", instance("weights", state, LinearWeights).W, Tensor), "W")
        if W.shape[-2:] != (self.n_hidden, self.n_outputs):
            raise ShapeError(
                f"initial W has shape {tuple(W.shape)}, not (..., {self.n_hidden}, "
                f"{self.n_outputs})"
            )
        if not bool(torch.isfinite(W).all()):
            raise ConfigError("initial weights: not all numbers are finite")
        return W.shape[:-2]

    def expand(self, state: LinearWeights, batch_shape: Sequence[int]) -> LinearWeights:
        """Weights of a whole batch."""
        return LinearWeights(state.W.expand(*batch_shape, *state.W.shape[-2:]))

    def features(self, nn_input: Tensor, state: LinearWeights) -> Features:
        """phi (..., N). There are no inner weights: z is before it, and the slope is nobody's."""
        hidden = self.basis(nn_input)
        return Features(nn_input, hidden, torch.zeros_like(hidden))

    def output(self, hidden: Tensor, state: LinearWeights) -> Tensor:
        """W' hidden (..., m)."""
        return row_times(hidden, state.W)

    def correction(self, feedback: Tensor, state: LinearWeights) -> Tensor:
        """W r (..., N)."""
        return times_column(state.W, feedback)

    def magnitude(self, state: LinearWeights) -> Tensor:
        """|W|_F (...,)."""
        return frobenius(state.W)

    def derivative(
        self,
        nn_input: Tensor,
        features: Features,
        drive: Drive,
        correction: Tensor,
        state: LinearWeights,
        laws: Any,
        mode: Any,
    ) -> tuple[LinearWeights, Any]:
        """By the law, for the features and the error."""
        rate, moved = self.law(drive, state.W, laws, mode)
        return LinearWeights(rate), moved

    def jump(
        self,
        nn_input: Tensor,
        features: Features,
        drive: Drive,
        correction: Tensor,
        state: LinearWeights,
        laws: Any,
        mode: Any,
    ) -> tuple[Any, Any]:
        """By the law."""
        return self.law.jump(drive, state.W, laws, mode)

    def input_slope(
        self, features: Features, state: LinearWeights, first: int, n: int
    ) -> Tensor | None:
        """W' d phi/dz over n inputs from number `first` (..., m, n)."""
        slope = self.basis.slope(features.pre, features.hidden)
        return None if slope is None else state.W.mT @ slope[..., first : first + n]
