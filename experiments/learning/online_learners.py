"""Who learns a stream of returning functions sample by sample."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import torch
from torch import Tensor, nn

import mann_torch as mt
from mann_torch.control import AdaptiveNetwork, Drive
from mann_torch.functional import times_column
from mann_torch.types import NetworkState

from ..sequence_tasks.streams import Stream, uniform
from ..settings.memory_config import LEARNERS, OnlineRegressionConfig

#: Powers of x whose averages with y tell functions apart; what state keys compare.
PRINTS = 4
#: The network's inputs: x now, and the sample before, x and y.
N_INPUTS = 3
FINGERPRINT_TIME = 0.2  # [s]
#: These keep their inner weights V, so that readouts stay valid.
FIXED = ("network_fixed", "readouts")
#: Whom a variant is compared with.
BASELINES = dict.fromkeys(LEARNERS[1:], "network") | {"readouts": "network_fixed"}


def samples(
    stream: Stream, k: int, count: int, generator: torch.Generator
) -> tuple[Tensor, Tensor, Tensor]:
    """Network inputs (count, B, 3), answers (count, B) and prints' basis (count, B, 4)."""
    x = uniform(generator, count + 1, stream.phase.shape[0])
    y = stream.value(k, x)
    inputs = torch.stack([x[1:], x[:-1], y[:-1]], dim=-1)
    basis = torch.stack([x[1:] ** power for power in range(PRINTS)], dim=-1)
    return inputs, y[1:], basis


class Learner(NamedTuple):
    """State of a batch of learners."""

    network: NetworkState
    cell: mt.CellState | None


class Looked(NamedTuple):
    """A prediction, and what an update needs."""

    prediction: Tensor  # (..., B)
    seen: mt.memory.Attended | None


class OnlineLearner(nn.Module):
    """The paper's network and update law, f^ = W'(sigma + h_o) + b_w, with or without a memory.

    `readouts` is a use of our own: slots hold [W; b_w] of a function each, found again by state
    keys that compare averages of y x^p; the update of W goes to the attended slot as the write
    law's correction. V is fixed, and so it is in `network_fixed`, its fair comparison.
    """

    def __init__(self, cfg: OnlineRegressionConfig, variant: str, rate: float) -> None:
        super().__init__()
        n_hidden = cfg.n_hidden
        if variant == "network_matched":
            n_hidden = mt.equal_parameter_hidden(N_INPUTS, 1, cfg.n_hidden, cfg.n_slots)
        self.variant, self.dt = variant, cfg.dt
        self.network = AdaptiveNetwork(
            N_INPUTS,
            n_hidden,
            1,
            rate_W=rate,
            rate_V=0.0 if variant in FIXED else rate,
            initial_std=cfg.initial_std,
        )
        self.cell: mt.MemoryCell | None = None
        attentions: dict[str, Callable[[], mt.Attention]] = {
            "soft": mt.SoftAttention,
            "hard": mt.HardAttention,
            "readouts": mt.HardAttention,
            "reallocating_initial": lambda: mt.ReallocatingAttention(
                "initial", cfg.shift_threshold
            ),
            "reallocating_always": lambda: mt.ReallocatingAttention("always", cfg.shift_threshold),
        }
        if variant in attentions:
            width = n_hidden + (variant == "readouts")
            rule = mt.StateKeys(cfg.key_rate) if variant == "readouts" else None
            self.cell = mt.MemoryCell.paper(
                width + PRINTS,
                width,
                cfg.n_slots,
                attentions[variant](),
                rule,
                context_size=PRINTS,
                features=Part(0, width),
                dt=cfg.dt,
                write_gain=cfg.write_gain,
                dtype=torch.float64,
            )
            self.cell.context = Part(width, width + PRINTS)

    def start(self, cfg: OnlineRegressionConfig, generator: torch.Generator) -> Learner:
        """Weights for every seed; a memory that starts as its first sample sets it."""
        network = self.network.initial_state((cfg.seeds,), generator)
        return Learner(network, None)

    def look(self, learner: Learner, inputs: Tensor, prints: Tensor, jump: bool) -> Looked:
        """Predict (..., B) at inputs (..., B, 3) and fingerprints (..., B, 4)."""
        hidden = self.network.features(inputs, learner.network).hidden
        if self.cell is None or learner.cell is None:
            return Looked(self.network.output(hidden, learner.network).squeeze(-1), None)
        seen = None
        x = self._cell_input(hidden, prints)
        if jump:
            seen = self.cell.attend(x, learner.cell)
            read = seen.read
        else:
            read = self.cell.flow(x, learner.cell).read
        if self.variant == "readouts":
            return Looked((read[..., :-1] * hidden).sum(-1) + read[..., -1], seen)
        return Looked(self.network.output(hidden + read, learner.network).squeeze(-1), seen)

    def begin(self, learner: Learner, inputs: Tensor, spread: Tensor) -> Learner:
        """The memory's start: c_w sigma of S inputs (S, B, 3), as equal slots would stay equal.

        Of readouts: zeros, with keys `spread` (B, S, 4).
        """
        if self.cell is None:
            return learner
        hidden = self.network.features(inputs, learner.network).hidden
        state = self.cell.initial_state(spread.shape[:1])
        if self.variant == "readouts":
            return learner._replace(cell=state._replace(mu=torch.zeros_like(state.mu), keys=spread))
        gain = self.cell.memory.write_gain
        return learner._replace(cell=state._replace(mu=gain * hidden.transpose(0, 1)))

    def update(self, learner: Learner, inputs: Tensor, error: Tensor, looked: Looked) -> Learner:
        """The paper's update law, one Euler step, and the write law, one exact step."""
        network, seen = learner.network, looked.seen
        features = self.network.features(inputs, network)
        if self.variant in FIXED:  # the law of W alone: sigma e, without V's share
            features = features._replace(slope=torch.zeros_like(features.slope))
        e = error.unsqueeze(-1)
        if self.variant == "readouts" and seen is not None:
            outer = seen.read.unsqueeze(-1)
            network = network._replace(W=outer[..., :-1, :], b_w=outer[..., -1, :])
        correction = times_column(network.W, e)
        drive = Drive.of_features(features.hidden, e, error.abs())
        change, _ = self.network.derivative(
            inputs, features, drive, correction, network, None, None
        )
        cell = learner.cell
        if self.cell is not None and seen is not None:
            if self.variant == "readouts":
                moved = torch.cat([change.W.squeeze(-1), change.b_w], dim=-1)
                correction = seen.read - self.cell.memory.write_gain * seen.hidden + moved
            cell = self.cell.write(seen, correction)
        after = (old + self.dt * rate for old, rate in zip(network, change, strict=True))
        return Learner(NetworkState(*after), cell)

    def _cell_input(self, hidden: Tensor, prints: Tensor) -> Tensor:
        one = [torch.ones_like(hidden[..., :1])] if self.variant == "readouts" else []
        return torch.cat([hidden, *one, prints], dim=-1)


class Part(nn.Module):
    """Some of the numbers of x (..., I)."""

    def __init__(self, first: int, end: int) -> None:
        super().__init__()
        self.first, self.end = first, end

    def forward(self, x: Tensor) -> Tensor:
        """x[first:end] (..., end - first)."""
        return x[..., self.first : self.end]
