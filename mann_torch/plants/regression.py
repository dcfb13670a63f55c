"""A regression to be estimated: a loop like any other."""

from __future__ import annotations

from typing import NamedTuple

import torch
from torch import Tensor

from ..domains import Finite, Positive
from ..trees import portable
from ..types import Channel
from .plant import Field, Input, Plant


@portable
class RegressionState(NamedTuple):
    """An oscillator, and what is not predicted."""

    phi: Tensor  # (..., 2)
    residual: Tensor  # (..., 1)


class RegressionParameters(NamedTuple):
    """What is sought, and how fast the regressor turns."""

    theta: Tensor  # (..., 2)
    frequency: Tensor  # (..., 1) [rad/s]
    decay: Tensor  # (..., 1) [1/s]


class RegressionMeasurement(NamedTuple):
    """What an estimator sees."""

    phi: Tensor  # (..., 2)
    y: Tensor  # (..., 1) theta' phi
    residual: Tensor  # (..., 1)


_FIELDS = {
    "theta": Field((1.0, 2.0), Finite(), "-"),
    "frequency": Field((1.0,), Positive(), "rad/s"),
    "decay": Field((1.0,), Positive(), "1/s"),
}


class Regression(Plant):
    """y = theta' phi, of phi = (sin w t, cos w t), that an input u is to predict.

    dphi/dt = w (phi_2, -phi_1) from (0, 1), d residual/dt = -decay residual + y - u: the output is
    the residual, and 0 what it is to follow. phi, y and residual are measured. The regressor whose
    estimators have closed forms: Narendra and Annaswamy, Stable Adaptive Systems, 1989.
    """

    Parameters = RegressionParameters
    fields = _FIELDS

    @property
    def inputs(self) -> tuple[Channel, ...]:
        """The prediction."""
        return (Channel("prediction", "-"),)

    @property
    def outputs(self) -> tuple[Channel, ...]:
        """The residual."""
        return (Channel("residual", "s"),)

    def rest(self) -> RegressionState:
        """phi = (0, 1), and no residual."""
        first = torch.tensor([0.0, 1.0], dtype=torch.float64)
        return RegressionState(first, torch.zeros(1, dtype=torch.float64))

    def output(self, state: RegressionState, coefficients: RegressionParameters) -> Tensor:
        """The residual (..., 1)."""
        return state.residual

    def measure(
        self, state: RegressionState, coefficients: RegressionParameters
    ) -> RegressionMeasurement:
        """All there is but theta."""
        return RegressionMeasurement(state.phi, _label(state, coefficients), state.residual)

    def derivative(
        self,
        t: Tensor,
        state: RegressionState,
        input: Input,
        disturbance: Tensor | None,
        coefficients: RegressionParameters,
    ) -> RegressionState:
        """(w phi_2, -w phi_1) and y - u - decay residual."""
        sin, cos = state.phi.split(1, dim=-1)
        turned = coefficients.frequency * torch.cat([cos, -sin], dim=-1)
        missed = _label(state, coefficients) - input.u
        return RegressionState(turned, missed - coefficients.decay * state.residual)


def _label(state: RegressionState, coefficients: RegressionParameters) -> Tensor:
    return (coefficients.theta * state.phi).sum(dim=-1, keepdim=True)
