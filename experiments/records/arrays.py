"""A trajectory's samples as arrays by name: what a run keeps in its .npz file, and draws."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from typing import Any

import numpy as np
import torch
from torch import Tensor

from mann_torch import Trajectory
from mann_torch.simulation import ClosedLoop, Scenario, observe
from mann_torch.trees import leaves
from mann_torch.types import Channel, Features, TrackingError

#: The loop's own names: a plant or a controller with a field called so has its path for a name.
OWN = (
    *("t", "output", "reference", "command", "error", "input", "applied"),
    *("outputs", "inputs", "parameters", "states", "adaptive"),
)
#: A controller's state of more numbers than this is left out, but a memory's contents are not.
MOST_NUMBERS = 64
CONTENTS = "mu"
#: Of these values, what is kept: the rest follows from it and the loop's own arrays.
_TELLING = {Features: ("hidden",), TrackingError: ("error_rate",)}


class _Kept:
    """Leaves of trees by name: a field's own, or its path where that is taken."""

    def __init__(self, lead: Sequence[int]) -> None:
        self.lead = torch.Size(lead)  # (K, draws)
        self.arrays: dict[str, np.ndarray] = {}

    def add(self, path: str, tree: Any, most: float = float("inf")) -> list[str]:
        """Names of what was kept: all leaves (K, draws, .) of at most that many numbers each."""
        names = []
        for where, leaf in _paths(path, tree):
            field, rows = where.rpartition(".")[2], self._rows(leaf)
            numbers = rows.shape[len(self.lead) :].numel()
            if not numbers or (numbers > most and field != CONTENTS):
                continue
            name = where if field in self.arrays or field in OWN else field
            self.arrays[name] = rows.detach().cpu().numpy()
            names.append(name)
        return names

    def _rows(self, leaf: Tensor) -> Tensor:
        """One that is the same at all samples is repeated."""
        if leaf.shape[: len(self.lead)] == self.lead:
            return leaf
        return leaf.expand(*self.lead, *leaf.shape)


def _paths(path: str, tree: Any) -> Iterator[tuple[str, Tensor]]:
    if isinstance(tree, Tensor):
        yield path, tree
    elif tree is not None:
        for name in _TELLING.get(type(tree), tree._fields):
            yield from _paths(f"{path}.{name}", getattr(tree, name))


def signal_arrays(
    loop: ClosedLoop, scenario: Scenario, trajectory: Trajectory
) -> dict[str, np.ndarray]:
    """The trajectory at its samples: `t` (K,) [s], numbers (K, draws, .), and texts.

    `output`, `reference`, `error`, `input` (commanded), `applied` where an actuator or a
    disturbance makes that another one, `command` where a reference model gives the reference. Then,
    by their fields' names: the plant's state, its parameters that a schedule moves, what the
    controller measures where that is no plain part of the state, the controller's signals, its
    state, and its mode. A name that is taken becomes a path: `controller.W`.

    Texts: `outputs`, `inputs` (., 2) and `parameters` (., 2), names with units, and `states`,
    `adaptive`, names of arrays: of the plant's state, and of the controller's signals and state.
    """
    seen, plant, t = observe(loop, scenario, trajectory), loop.plant, trajectory.sample_t
    states, outside = trajectory.states, scenario.disturbance
    batch = leaves(states.plant)[0].shape[1:-1]
    kept = _Kept((len(t), *batch))
    wanted = seen.reference.value
    own = {"output": seen.output, "reference": wanted, "error": wanted - seen.output}
    own["input"] = seen.input
    if loop.actuator is not None or (outside is not None and outside.input is not None):
        own["applied"] = seen.applied
    if seen.reference.command is not None:
        own["command"] = seen.reference.command
    found = {"t": t.numpy()} | {name: value.detach().numpy() for name, value in own.items()}
    of_state = kept.add("state", states.plant)
    moved = scenario.parameters_at(t)
    scheduled = []
    for name in scenario.schedule:
        value = getattr(moved, name)
        lone = (len(t), *(1,) * (len(batch) - value.dim() + 2), *value.shape[1:])
        rows = value.reshape(lone).expand(len(t), *batch, value.shape[-1])
        (called,) = kept.add(f"parameters.{name}", rows)
        scheduled.append(Channel(called, plant.fields[name].unit))
    if (
        loop.sensor is not None
        or scenario.noise is not None
        or (outside is not None and outside.output is not None)
    ):
        kept.add("measurement", seen.measurement)
    adaptive = kept.add("signals", seen.signals)
    adaptive += kept.add("controller", states.controller, MOST_NUMBERS)
    kept.add("mode", trajectory.modes)
    texts = {"outputs": plant.outputs, "inputs": plant.inputs, "parameters": scheduled}
    found |= {name: _table(rows) for name, rows in texts.items()}
    found |= {"states": np.array(of_state, str), "adaptive": np.array(adaptive, str)}
    return found | kept.arrays


def _table(channels: Iterable[Channel]) -> np.ndarray:
    """(., 2) text: names and units."""
    return np.array([tuple(each) for each in channels], str).reshape(-1, 2)
