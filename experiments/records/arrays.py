"""A trajectory's samples as arrays by name: what a run keeps in its .npz file, and draws."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from typing import Any

import numpy as np
import torch
from torch import Tensor

from mann_torch import Trajectory
from mann_torch.simulation import ClosedLoop, Observation, Scenario, observe
from mann_torch.trees import leaves
from mann_torch.types import Features, TrackingError

#: The loop's own names: a plant or a controller with a field called so has its path for a name.
OWN = (
    *("t", "output", "reference", "command", "error", "input", "applied", "disturbance"),
    *("outputs", "inputs", "disturbances", "parameters", "states", "adaptive"),
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
    disturbance makes that another one, `command` where a reference model gives the reference,
    `disturbance`, of the plant's own, where there is one. Then, by their fields' names: the plant's
    state, its parameters that a schedule moves, what the controller measures where that is no plain
    part of the state, the controller's signals, its state, and its mode. A name that is taken
    becomes a path: `controller.W`.

    Texts: `outputs`, `inputs`, `disturbances` and `parameters` (., 2), names with units, `states`,
    `adaptive`, names of arrays: of the plant's state, and of the controller's signals and state.
    """
    seen, plant = observe(loop, scenario, trajectory), loop.plant
    t, states, acting = trajectory.sample_t, trajectory.states, scenario.disturbance
    batch = leaves(states.plant)[0].shape[1:-1]
    own = _of_the_loop(seen)
    if loop.actuator is None and (acting is None or acting.input is None):
        del own["applied"]
    if acting is not None and acting.plant is not None:
        own["disturbance"] = acting.expand(batch)(t).plant
    kept = _Kept((len(t), *batch))
    texts = {"states": kept.add("state", states.plant)}
    scheduled = _scheduled(scenario, t, batch)
    called = [kept.add(f"parameters.{name}", rows)[0] for name, rows in scheduled.items()]
    units = [plant.fields[name].unit for name in scheduled]
    if (
        loop.sensor is not None
        or scenario.noise is not None
        or (acting is not None and acting.output is not None)
    ):
        kept.add("measurement", seen.measurement)
    texts["adaptive"] = kept.add("signals", seen.signals)
    texts["adaptive"] += kept.add("controller", states.controller, MOST_NUMBERS)
    kept.add("mode", trajectory.modes)
    tables: dict[str, Iterable[tuple[str, str]]] = {
        "outputs": plant.outputs,
        "inputs": plant.inputs,
        "disturbances": plant.disturbances if "disturbance" in own else (),
        "parameters": zip(called, units, strict=True),
    }
    found = {"t": t} | own
    return (
        {name: value.detach().cpu().numpy() for name, value in found.items()}
        | {name: np.array([*map(tuple, rows)], str).reshape(-1, 2) for name, rows in tables.items()}
        | {name: np.array(names, str) for name, names in texts.items()}
        | kept.arrays
    )


def _of_the_loop(seen: Observation) -> dict[str, Tensor]:
    wanted = seen.reference.value
    own = {"output": seen.output, "reference": wanted, "error": wanted - seen.output}
    own |= {"input": seen.input, "applied": seen.applied}
    return own if seen.reference.command is None else own | {"command": seen.reference.command}


def _scheduled(scenario: Scenario, t: Tensor, batch: Sequence[int]) -> dict[str, Tensor]:
    """Parameters that a schedule moves, (K, draws, d)."""
    return {name: schedule.expand(batch).at(t) for name, schedule in scenario.schedule.items()}
