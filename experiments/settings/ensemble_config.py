"""Schema of `ensemble`: many rollouts of one scenario, of which totals are kept."""

from __future__ import annotations

from dataclasses import dataclass, field

from .config import LoopConfig, PicturesConfig


@dataclass
class MassesConfig:
    """Random masses: each of `plant.masses` times a factor of its own, 1 +- `spread`, uniform."""

    spread: float = 0.2


@dataclass
class EnsembleConfig(LoopConfig):
    """Rollout k has draw `initial.draw` + k of the initial weights, and masses number k."""

    masses: MassesConfig = field(default_factory=MassesConfig)
    output: PicturesConfig = field(default_factory=PicturesConfig)
    first: int = 0  # number of the first rollout
    rollouts: int = 1000
    chunk: int = 250  # rollouts computed and kept at once
    workers: int = 2


#: Settings that say which rollouts, and in what portions: they may differ where ensembles are
#: put together.
PORTION = ("first", "rollouts", "chunk")
