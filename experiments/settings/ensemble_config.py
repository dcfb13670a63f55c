"""Schema of `ensemble`: many rollouts of one scenario, of which totals are kept."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from .config import PicturesConfig, ScenarioLoopConfig


@dataclass
class EnsembleConfig(ScenarioLoopConfig):
    """Rollout k has draw `initial.draw` + k of the initial weights, and parameters number k.

    `spread` names parameters of the plant: each of their numbers times a factor of its own,
    1 +- the spread, uniform.
    """

    spread: dict[str, Any] = field(default_factory=dict)
    output: PicturesConfig = field(default_factory=PicturesConfig)
    first: int = 0  # number of the first rollout
    rollouts: int = 1000
    chunk: int = 250  # rollouts computed and kept at once
    workers: int = 2


#: Settings that say which rollouts, and in what portions: they may differ where ensembles are
#: put together.
PORTION = ("first", "rollouts", "chunk")
