"""A readout a slot beside the network's own, attended by how well each explains what was needed."""

from __future__ import annotations

from collections.abc import Collection, Sequence
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

    held: Any  # the network's weights: outer ones (..., S, *event), M_i; None for all others
    misses: Tensor  # (..., S) E_i, in the output's unit squared


class Readouts(DesignModule):
    """S readouts M_i beside a network's own W: f^ = (W + sum_i w_i M_i)' sigma.

    Whatever law moves W moves a slot with the regressor w_i sigma, and W itself by the share c:

    - d M_i/dt = w_i dW/dt (slots that are not attended stand still), dW/dt = c dW/dt of the law;
    - d E_i/dt = (|y - (W + M_i)' sigma|^2 - E_i) / tau, the slot's own recent error;
    - w_i = E_i^-beta / sum_j E_j^-beta, which tells regimes apart: nothing of x does.

    y is what was needed: a measured label (`Drive.pair`), or the input that feedback and network
    gave together (`Drive.shortfall`). f = W*'sigma is (W* + sum_i w_i 0)'sigma too, so [sigma,
    w_1 sigma, ..., w_S sigma] is a regressor with constant unknowns whatever w(t) is, and
    V = r'Mr/2 + tr W~'W~/2 c C + sum_i tr M_i'M_i/2 C falls as fast as the plain network's.

    Constants: `recall_time` tau [s], `sharpness` beta [-], `common` c [-]. `spread` is the standard
    deviation of M_i at t = 0 (slot 0 starts at 0): equal slots would stay equal. One slot with
    c = 0 is the plain network. Our own; kin of multiple models (Narendra and Balakrishnan 1997) and
    of MOSAIC (Haruno, Wolpert and Kawato 2001). Raises `ConfigError`, `DomainError`, `KindError`,
    `DtypeError`.
    """

    def __init__(
        self,
        n_slots: int = 5,
        recall_time: Numbers = 0.03,
        sharpness: Numbers = 2.0,
        spread: float = 0.1,
        common: Numbers = 1.0,
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

    def fit(self, network: FeatureNetwork, offers: Collection[str]) -> None:
        """Draw what slots start with, in the form of a network's W.

        Raises `ConfigError` for a network that names none, or with nothing to judge slots by.
        """
        if not network.outer:
            raise ConfigError(f"readouts: {type(network).__name__} does not say what W is: `outer`")
        if not {"pair", "shortfall"} & set(offers):
            raise ConfigError(
                "readouts are judged by what was needed, and this controller has nothing to tell: "
                "give it labels"
            )
        generator, weights = torch.Generator().manual_seed(0), network.initial_state(())
        for name in network.outer:
            shape = self.n_slots, *getattr(weights, name).shape
            draw = torch.randn(shape, generator=generator, dtype=torch.float64)
            draw[0] = 0.0
            self.register_buffer(f"first_{name}", self.spread * draw, persistent=False)

    def initial_state(
        self, network: FeatureNetwork, weights: Any, batch_shape: Sequence[int]
    ) -> ReadoutState:
        """Nothing in slot 0, others `spread` away, the same in each sample of the batch."""
        batch, held = sizes("batch_shape", batch_shape), dict.fromkeys(weights._fields)
        for name in network.outer:
            first = getattr(self, f"first_{name}")
            held[name] = first.expand(*batch, *first.shape)
        misses = torch.ones(*batch, self.n_slots, dtype=torch.float64)
        return ReadoutState(type(weights)(**held), misses)

    def weights(self, state: ReadoutState) -> Tensor:
        """w (..., S)."""
        levels = torch.log(state.misses + FLOOR)
        return torch.softmax(-self.sharpness.unsqueeze(-1) * levels, dim=-1)

    def blended(self, network: FeatureNetwork, weights: Any, state: ReadoutState) -> Any:
        """The network's weights with W + sum_i w_i M_i for W."""
        share, found = self.weights(state), {}
        for name in network.outer:
            held = getattr(state.held, name)
            read = (_beside(share, held) * held).sum(share.dim() - 1)
            found[name] = getattr(weights, name) + read
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
        """Time derivatives of the network's own weights and of the slots.

        `moved` is what the law makes of the blend, `output` (..., m) what the blend gives at
        `hidden` (..., N), with what a memory adds.
        """
        share, dim = self.weights(state), state.misses.dim() - 1
        slots, rates, own = {}, {}, {}
        for name in network.outer:
            held, change = getattr(state.held, name), getattr(moved, name)
            slots[name] = getattr(weights, name).unsqueeze(dim) + held
            rates[name] = _beside(share, held) * change.unsqueeze(dim)
            own[name] = _beside(self.common, change) * change
        if drive.pair is not None:
            hidden, needed = drive.pair.regressor.squeeze(-1), drive.pair.label
        else:
            short = torch.zeros_like(output) if drive.shortfall is None else drive.shortfall
            needed = (output + short).unsqueeze(-2)
        given = network.output(hidden.unsqueeze(-2), weights._replace(**slots))
        squared = (needed - given).square().sum(dim=-1)
        misses = (squared - state.misses) / self.recall_time.unsqueeze(-1)
        return moved._replace(**own), ReadoutState(state.held._replace(**rates), misses)


def _beside(share: Tensor, held: Tensor) -> Tensor:
    """Weights (..., S) beside (..., S, *event)."""
    return share.reshape(*share.shape, *(1,) * (held.dim() - share.dim()))
