"""Who learns a stream of returning functions sample by sample."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import torch
from torch import Tensor, nn

import mann_torch as mt
from mann_torch.control import AdaptiveNetwork, Drive, Readouts, ReadoutState
from mann_torch.functional import times_column
from mann_torch.trees import map_tensors
from mann_torch.types import NetworkState

from ..sequence_tasks.streams import Stream, uniform
from ..settings.memory_config import LEARNERS, OnlineRegressionConfig

#: The network's inputs: x now, and the sample before, x and y.
N_INPUTS = 3
#: Whom a variant is compared with.
BASELINES = dict.fromkeys(LEARNERS[1:], "network")


def samples(
    stream: Stream, k: int, count: int, generator: torch.Generator
) -> tuple[Tensor, Tensor]:
    """Network inputs (count, B, 3) and answers (count, B)."""
    x = uniform(generator, count + 1, stream.phase.shape[0])
    y = stream.value(k, x)
    return torch.stack([x[1:], x[:-1], y[:-1]], dim=-1), y[1:]


class Learner(NamedTuple):
    """State of a batch of learners."""

    network: NetworkState
    cell: mt.CellState | None = None
    readouts: ReadoutState | None = None


class Looked(NamedTuple):
    """A prediction, and what an update needs."""

    prediction: Tensor  # (..., B)
    seen: mt.memory.Attended | None


class OnlineLearner(nn.Module):
    """The paper's network and update law, f^ = W'(sigma + h_o) + b_w, with or without a memory.

    `readouts` are slots of [W; b_w], moved by the same law and attended by their own errors
    (`mann_torch.control.Readouts`): y is the answer.
    """

    def __init__(self, cfg: OnlineRegressionConfig, variant: str, rate: float) -> None:
        super().__init__()
        n_hidden = cfg.n_hidden
        if variant == "network_matched":
            n_hidden = mt.equal_parameter_hidden(N_INPUTS, 1, cfg.n_hidden, cfg.n_slots)
        self.dt = cfg.dt
        self.network = AdaptiveNetwork(
            N_INPUTS, n_hidden, 1, rate_W=rate, rate_V=rate, initial_std=cfg.initial_std
        )
        self.cell: mt.MemoryCell | None = None
        self.readouts: Readouts | None = None
        if variant == "readouts":
            self.readouts = Readouts(
                cfg.n_slots, cfg.recall_time, cfg.sharpness, cfg.spread, cfg.common
            )
            self.readouts.fit(self.network, {"shortfall"})
        attentions: dict[str, Callable[[], mt.Attention]] = {
            "soft": mt.SoftAttention,
            "hard": mt.HardAttention,
            "reallocating_initial": lambda: mt.ReallocatingAttention(
                "initial", cfg.shift_threshold
            ),
            "reallocating_always": lambda: mt.ReallocatingAttention("always", cfg.shift_threshold),
        }
        if variant in attentions:
            self.cell = mt.MemoryCell.paper(
                n_hidden,
                n_hidden,
                cfg.n_slots,
                attentions[variant](),
                features=nn.Identity(),
                dt=cfg.dt,
                write_gain=cfg.write_gain,
                dtype=torch.float64,
            )

    def start(self, cfg: OnlineRegressionConfig, generator: torch.Generator) -> Learner:
        """Weights for every seed; a memory that starts as its first sample sets it."""
        return Learner(self.network.initial_state((cfg.seeds,), generator))

    def begin(self, learner: Learner, inputs: Tensor) -> Learner:
        """The memory's start: c_w sigma of S inputs (S, B, 3), as equal slots would stay equal."""
        if self.cell is None:
            return self.wiped(learner)
        hidden = self.network.features(inputs, learner.network).hidden
        state = self.cell.initial_state(inputs.shape[1:2])
        gain = self.cell.memory.write_gain
        return learner._replace(cell=state._replace(mu=gain * hidden.transpose(0, 1)))

    def wiped(self, learner: Learner) -> Learner:
        """Readouts as they start, about their mean: nothing of them is left but that."""
        if self.readouts is None:
            return learner
        network, batch = learner.network, learner.network.W.shape[:1]
        if learner.readouts is not None:
            held = learner.readouts.held
            mean = {name: getattr(held, name).mean(dim=1) for name in self.network.outer}
            moved = {name: getattr(network, name) + value for name, value in mean.items()}
            network = network._replace(**moved)
        fresh = self.readouts.initial_state(self.network, network, batch)
        return learner._replace(network=network, readouts=fresh)

    def look(self, learner: Learner, inputs: Tensor, jump: bool) -> Looked:
        """Predict (..., B) at inputs (..., B, 3)."""
        network = self._in_force(learner)
        hidden, seen = self.network.features(inputs, network).hidden, None
        if self.cell is not None and learner.cell is not None:
            seen = self.cell.attend(hidden, learner.cell) if jump else None
            read = self.cell.flow(hidden, learner.cell).read if seen is None else seen.read
            hidden = hidden + read
        return Looked(self.network.output(hidden, network).squeeze(-1), seen)

    def held(self, learner: Learner, inputs: Tensor) -> Tensor:
        """What each readout says (S, ..., B) at inputs (..., B, 3); of all others S = 1."""
        network, readouts = learner.network, learner.readouts
        if readouts is None:
            return self.look(learner, inputs, jump=False).prediction.unsqueeze(0)
        hidden = self.network.features(inputs, network).hidden
        found = []
        for i in range(readouts.misses.shape[-1]):
            own = {n: getattr(network, n) + getattr(readouts.held, n)[:, i] for n in network._fields
                   if n in self.network.outer}  # fmt: skip
            found.append(self.network.output(hidden, network._replace(**own)).squeeze(-1))
        return torch.stack(found)

    def update(self, learner: Learner, inputs: Tensor, error: Tensor, looked: Looked) -> Learner:
        """The paper's update law, one Euler step, and the write law, one exact step."""
        network, seen = self._in_force(learner), looked.seen
        features, e = self.network.features(inputs, network), error.unsqueeze(-1)
        correction = times_column(network.W, e)
        drive = Drive.of_features(features.hidden, e, error.abs(), shortfall=e)
        change, _ = self.network.derivative(
            inputs, features, drive, correction, network, None, None
        )
        cell, readouts = learner.cell, learner.readouts
        if self.cell is not None and seen is not None:
            cell = self.cell.write(seen, correction)
        if self.readouts is not None and readouts is not None:
            output = self.network.output(features.hidden, network)
            change, rates = self.readouts.rates(
                self.network, learner.network, change, features.hidden, output, drive, readouts
            )
            readouts = map_tensors(self._stepped, readouts, rates)
        return Learner(map_tensors(self._stepped, learner.network, change), cell, readouts)

    def _stepped(self, old: Tensor, rate: Tensor) -> Tensor:
        return old + self.dt * rate

    def _in_force(self, learner: Learner) -> NetworkState:
        if self.readouts is None or learner.readouts is None:
            return learner.network
        blend: NetworkState = self.readouts.blended(self.network, learner.network, learner.readouts)
        return blend
