"""A network of radial basis functions: linear in its weights, which any law moves."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import torch
from torch import Tensor

from ..checks import POSITIVE, instance, number, sizes, whole
from ..errors import ConfigError, ShapeError
from ..functional import Numbers, as_float64, frobenius, row_times, times_column
from ..trees import leaves, map_tensors, portable
from ..types import Features
from .feature_network import FeatureNetwork
from .laws import GradientLaw, Law


@portable
class LinearWeights(NamedTuple):
    """Weights of features that do not move, and what their law keeps."""

    W: Tensor  # (..., N, m)
    law: Any  # state of the law


class RadialBasisNetwork(FeatureNetwork):
    """f^ = W' sigma(x~), sigma_i = exp(-|x~ - c_i|^2 / (2 width^2)); W starts at 0.

    `centers` c are (N, I). W moves by `law`, `GradientLaw(10)` if not given, driven by the error
    feedback. Raises `ShapeError`, `ConfigError`, `KindError` or `DtypeError`.
    """

    def __init__(
        self, centers: Numbers, n_outputs: int, width: float = 1.0, law: Law | None = None
    ) -> None:
        super().__init__()
        rows = as_float64(centers, "centers")
        if rows.dim() != 2:
            raise ShapeError(f"centers of shape {tuple(rows.shape)}: give a row (I,) a feature")
        self.n_hidden, self.n_inputs = rows.shape
        self.n_outputs = whole("n_outputs", n_outputs)
        self.width = number("width", width, POSITIVE)
        self.law = GradientLaw(10.0) if law is None else instance("law", law, Law)
        self.centers: Tensor
        self.register_buffer("centers", rows)

    @classmethod
    def scattered(
        cls,
        n_inputs: int,
        n_hidden: int,
        n_outputs: int,
        width: float = 1.0,
        law: Law | None = None,
        seed: int = 0,
    ) -> RadialBasisNetwork:
        """Centers from a standard normal law, by seed."""
        generator = torch.Generator().manual_seed(whole("seed", seed, least=0))
        shape = (whole("n_hidden", n_hidden), whole("n_inputs", n_inputs))
        centers = torch.randn(*shape, generator=generator, dtype=torch.float64)
        return cls(centers, n_outputs, width, law)

    def initial_state(
        self, batch_shape: Sequence[int], generator: torch.Generator | None = None
    ) -> LinearWeights:
        """W = 0; nothing is random."""
        batch = sizes("batch_shape", batch_shape)
        W = torch.zeros(*batch, self.n_hidden, self.n_outputs, dtype=torch.float64)
        return LinearWeights(W, self.law.initial_state(self.n_hidden, self.n_outputs, batch))

    def check_state(self, state: LinearWeights) -> torch.Size:
        """Batch shape of weights. Raises `ShapeError`, `ConfigError`, `KindError`, `DtypeError`."""
        W = as_float64(instance("W", instance("weights", state, LinearWeights).W, Tensor), "W")
        if W.shape[-2:] != (self.n_hidden, self.n_outputs):
            raise ShapeError(
                f"initial W has shape {tuple(W.shape)}, not (..., {self.n_hidden}, "
                f"{self.n_outputs})"
            )
        for leaf in leaves(state):
            if not bool(torch.isfinite(leaf).all()):
                raise ConfigError("initial weights: not all numbers are finite")
        return W.shape[:-2]

    def expand(self, state: LinearWeights, batch_shape: Sequence[int]) -> LinearWeights:
        """Weights of a whole batch."""
        depth, shape = state.W.dim() - 2, tuple(batch_shape)
        return map_tensors(lambda leaf: leaf.expand(*shape, *leaf.shape[depth:]), state)

    def features(self, nn_input: Tensor, state: LinearWeights) -> Features:
        """sigma (..., N); there is nothing before it, and no inner weights for its slope."""
        gaps = nn_input.unsqueeze(-2) - self.centers
        hidden = torch.exp(gaps.square().sum(dim=-1) * (-0.5 / self.width**2))
        return Features(hidden, hidden, torch.zeros_like(hidden))

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
        feedback: Tensor,
        correction: Tensor,
        error_norm: Tensor,
        state: LinearWeights,
    ) -> LinearWeights:
        """By the law, for the features and the error feedback r."""
        return LinearWeights(*self.law(features.hidden, feedback, state.W, state.law))
