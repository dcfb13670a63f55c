"""A readout a slot, attended by how well each explains what was needed of late."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import torch
from torch import Tensor

from ...checks import NONNEGATIVE, number, sizes, whole
from ...constraints import DesignModule, NonNegative, Positive
from ...errors import ConfigError
from ...functional import Numbers
from ...trees import portable
from ..laws import Drive
from .feature_network import FeatureNetwork

#: Added to an averaged squared error, so that a perfect readout has a finite weight.
FLOOR = 1e-6


@portable
class ReadoutState(NamedTuple):
    """What the slots hold."""

    held: Any  # the network's weights, outer ones (..., S, *event) as changes to its own, else None
    misses: Tensor  # (..., S) E_i


class Readouts(DesignModule):
    """S readouts m_i in place of a network's one: W = sum_i w_i m_i, so f^ = sum_i w_i m_i'sigma.

    dm_i/dt = w_i dW/dt, by whatever law moves W; with the gradient law this is that of the
    regressor w_i sigma, so that Lyapunov's function sums over slots and its derivative is that of
    one readout, whatever the weights do. Attended are those that explain what is needed:
    dE_i/dt = (|y - m_i'sigma|^2 - E_i) / tau, w_i = E_i^-beta / sum_j E_j^-beta, where y is a
    measured label, or the input that feedback and readout together gave (`Drive.shortfall`).

    Constants: `recall_time` tau [s], `sharpness` beta [-]. `spread` is the standard deviation by
    which slots differ at first: equal ones would stay equal. One slot is the network by itself.
    Multiple models that are blended: Narendra and Balakrishnan 1997; Haruno, Wolpert and Kawato
    2001. Raises `ConfigError`, `DomainError`, `KindError`, `DtypeError`.
    """

    def __init__(
        self,
        n_slots: int = 3,
        recall_time: Numbers = 0.03,
        sharpness: Numbers = 2.0,
        spread: float = 0.1,
        common: Numbers = 0.3,
    ) -> None:
        super().__init__()
        self.n_slots = whole("n_slots", n_slots)
        self.spread = number("spread", spread, NONNEGATIVE)
        self.recall_time: Tensor
        self.sharpness: Tensor
        self.common: Tensor
        self.declare("recall_time", recall_time, Positive())
        self.declare("sharpness", sharpness, Positive())
        self.declare("common", common, NonNegative())

    def check_fit(self, network: FeatureNetwork, offers: Sequence[str]) -> None:
        """Raise `ConfigError` for a network without outer weights, or nothing to judge slots by."""
        if not network.outer:
            raise ConfigError(f"readouts: {type(network).__name__} names no outer weights")
        if not {"pair", "shortfall"} & set(offers):
            raise ConfigError(
                "readouts need labels: this controller gives nothing to judge them by"
            )

    def initial_state(
        self, network: FeatureNetwork, weights: Any, batch_shape: Sequence[int]
    ) -> ReadoutState:
        """The network's own in the first slot, others `spread` away; the same in each sample."""
        batch, generator = sizes("batch_shape", batch_shape), torch.Generator().manual_seed(0)
        held = dict.fromkeys(weights._fields)
        for name in network.outer:
            event = getattr(weights, name).shape[len(batch) :]
            draw = torch.randn(self.n_slots, *event, generator=generator, dtype=torch.float64)
            draw[0] = 0.0
            held[name] = (self.spread * draw).expand(*batch, *draw.shape)
        misses = torch.ones(*batch, self.n_slots, dtype=torch.float64)
        return ReadoutState(type(weights)(**held), misses)

    def weights(self, state: ReadoutState) -> Tensor:
        """w (..., S)."""
        levels = torch.log(state.misses + FLOOR)
        return torch.softmax(-self.sharpness.unsqueeze(-1) * levels, dim=-1)

    def blended(self, network: FeatureNetwork, weights: Any, state: ReadoutState) -> Any:
        """The network's weights with sum_i w_i m_i for outer ones."""
        share, found = self.weights(state), {}
        for name in network.outer:
            held = getattr(state.held, name)
            found[name] = getattr(weights, name) + (_beside(share, held) * held).sum(
                share.dim() - 1
            )
        return weights._replace(**found)

    def rates(
        self,
        network: FeatureNetwork,
        weights: Any,
        moved: Any,
        hidden: Tensor,
        output: Tensor,
        drive: Drive,
        state: ReadoutState,
    ) -> tuple[Any, ReadoutState]:
        """Of the network's weights, whose outer ones stand still, and of the slots.

        `moved` is what the law makes of the blend, `output` (..., m) what that gives at `hidden`
        (..., N), read and all.
        """
        share, rate = self.weights(state), {}
        slots, still = {}, {}
        for name in network.outer:
            held, change = getattr(state.held, name), getattr(moved, name)
            dim = share.dim() - 1
            slots[name] = getattr(weights, name).unsqueeze(dim) + held
            rate[name] = _beside(share, held) * change.unsqueeze(dim)
            still[name] = _beside(self.common, change) * change
        if drive.pair is not None:
            hidden, needed = drive.pair.regressor.squeeze(-1), drive.pair.label
        elif drive.shortfall is not None:
            needed = (output + drive.shortfall).unsqueeze(-2)
        given = network.output(hidden.unsqueeze(-2), weights._replace(**slots))
        squared = (needed - given).square().sum(-1)
        tau = self.recall_time.unsqueeze(-1)
        return moved._replace(**still), ReadoutState(
            state.held._replace(**rate), (squared - state.misses) / tau
        )


def _beside(share: Tensor, held: Tensor) -> Tensor:
    """Weights (..., S) beside (..., S, *event)."""
    return share.reshape(*share.shape, *(1,) * (held.dim() - share.dim()))
