"""The paper's scenarios as the experiments build them, all of one controller in one batch."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import torch

import mann_torch as mt
from experiments.building.batching import side_by_side
from experiments.building.build import build
from experiments.building.ensembles import composed
from experiments.command.conf_files import group_names
from mann_torch.types import MemoryState, NetworkState
from tests.conftest import randn

SCENARIOS = tuple(name for name in group_names("scenario") if name != "plain")
CONTROLLERS = {
    "nn": ("controller=nn",),
    **{
        name + tail: (f"controller={name}", *keys)
        for name in ("soft", "hard", "reallocating_initial", "reallocating_always")
        for tail, keys in (("", ()), ("_state_keys", ("keys=state",)))
    },
}
#: From the paper's start all slots of soft attention hold the same, and stay together for ever:
#: its weights are 1/S, and keys count for nothing. Here slots and keys start apart.
APART = "_apart"


class Side(NamedTuple):
    """One controller in several scenarios (B,), an unbatched one each besides."""

    loop: mt.ClosedLoop
    scenario: mt.Scenario
    weights: NetworkState
    each: tuple[mt.Scenario, ...]

    def run(self, **arguments: object) -> mt.Trajectory:
        """Roll it out, without gradients."""
        with torch.no_grad():
            return mt.rollout(self.loop, self.scenario, weights=self.weights, **arguments)


def side(
    name: str, scenarios: Sequence[str] = SCENARIOS, horizon: float | None = None, draws: int = 1
) -> Side:
    """A controller in scenarios of the paper; B counts all draws of all scenarios in order."""
    given = [*CONTROLLERS[name.removesuffix(APART)], f"draws={draws}"]
    given += [] if horizon is None else [f"horizon={horizon}"]
    parts = [build(composed((f"scenario='{s}'", *given))) for s in scenarios]
    scenario, network, own = side_by_side(parts, draws)
    loop = parts[0].loop
    loop.controller.initialize(**own)
    if name.endswith(APART):
        memory = loop.controller.memory
        assert memory is not None
        mu, keys = memory.initial_mu.shape, memory.initial_keys.shape
        memory.store_(MemoryState(0.4 + 0.2 * randn(*mu, seed=2), 0.5 * randn(*keys, seed=3)))
    return Side(loop, scenario, network, tuple(part.alone or part.scenario for part in parts))
