"""Schema of `ensemble`: many rollouts of one scenario, of which totals are kept."""

from __future__ import annotations

from dataclasses import dataclass, field

from .config import (
    ConstantsConfig,
    ControllerConfig,
    InitialConfig,
    KeysConfig,
    MemoryConfig,
    PicturesConfig,
    PlantConfig,
    ScenarioConfig,
    SolverConfig,
)


@dataclass
class MassesConfig:
    """Random masses: each of `plant.masses` times a factor of its own, 1 +- `spread`, uniform."""

    spread: float = 0.2


@dataclass
class EnsembleConfig:
    """Rollout k has draw `initial.draw` + k of the initial weights, and masses number k."""

    plant: PlantConfig = field(default_factory=PlantConfig)
    keys: KeysConfig = field(default_factory=KeysConfig)
    controller: ControllerConfig = field(default_factory=ControllerConfig)
    memory: MemoryConfig = field(default_factory=MemoryConfig)
    constants: ConstantsConfig = field(default_factory=ConstantsConfig)
    scenario: ScenarioConfig = field(default_factory=ScenarioConfig)
    solver: SolverConfig = field(default_factory=SolverConfig)
    initial: InitialConfig = field(default_factory=InitialConfig)
    masses: MassesConfig = field(default_factory=MassesConfig)
    horizon: float | None = None  # [s], the scenario's own if null
    first: int = 0  # number of the first rollout
    rollouts: int = 1000
    chunk: int = 250  # rollouts computed and kept at once
    workers: int = 2
    output: PicturesConfig = field(default_factory=PicturesConfig)
    seed: int = 0
    run_dir: str | None = None


#: Settings that say which rollouts, and in what portions: they may differ where ensembles are
#: put together.
PORTION = ("first", "rollouts", "chunk")
