"""How much memory rollouts take, told from their settings alone: nothing large is allocated."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from mann_torch import MeasurementNoise
from mann_torch.errors import ConfigError
from mann_torch.plants import Plant
from mann_torch.trees import leaves

from ..settings.checks import check_positive
from ..settings.config import LoopConfig, SimulateConfig
from ..settings.machine import check_memory
from .controller_kinds import hidden_neurons, is_mann, mann_settings
from .plants import build_plant

_FLOAT = 8
#: A state is there at least as initial weights, as what a rollout starts from, and as its end.
_COPIES = 3
#: A run of more steps, or with more samples, is a slip of the pen.
MOST_STEPS = 1e8
#: Numbers in the state of a controller that is not the paper's kind: settings do not tell.
_OTHER = 100


def rollout_bytes(cfg: LoopConfig, plant: Plant) -> float:
    """Of one state: the plant's, W, b_w, V, b_v, and mu and keys where there is a memory."""
    own = sum(leaf.shape[-1] for leaf in leaves(plant.rest()))
    if not is_mann(cfg):
        return float(_FLOAT * (own + _OTHER))
    n = len(plant.outputs)
    N = hidden_neurons(cfg, n)
    slots = cfg.memory.n_slots if mann_settings(cfg).attention is not None else 0
    # Of another network the state is smaller, and what its features are made of is not.
    return float(_FLOAT * (own + n * (N + 1) + N * (5 * n + 1) + slots * (N + n)))


def check_rollouts(what: str, cfg: LoopConfig, plant: Plant, count: int) -> None:
    """Raise `ConfigError` where `count` rollouts side by side do not fit the machine."""
    sizes = f"plant.name = {cfg.plant['name']}"
    if is_mann(cfg):
        sizes = f"controller.n_hidden = {hidden_neurons(cfg, len(plant.outputs))}"
        if mann_settings(cfg).attention is not None:
            sizes += f", memory.n_slots = {cfg.memory.n_slots}"
    check_memory(f"{what} with {sizes}", _COPIES * count * rollout_bytes(cfg, plant))


def check_states(what: str, start: Any, count: int) -> None:
    """The same, for what one of them starts from: settings do not tell of every part's state."""
    size = sum(leaf.numel() for leaf in leaves(start))
    check_memory(what, float(_COPIES) * count * _FLOAT * size)


def check_steps(horizon: float, dt: float) -> None:
    """Raise `ConfigError` where a horizon [s] has too many steps of `dt` [s] for a grid."""
    if horizon / dt > MOST_STEPS:
        raise ConfigError(
            f"horizon = {horizon:g} s in steps of solver.dt = {dt:g} s: more than "
            f"{MOST_STEPS:.0e} steps"
        )
    check_memory(f"horizon = {horizon:g} s", 3 * _FLOAT * horizon / dt)


def check_noise(noise: MeasurementNoise, widths: Sequence[int], horizon: float, dt: float) -> None:
    """Raise `ConfigError` where noise does not fit a measurement, or its numbers are too many."""
    if noise.std.shape[-1] not in (len(widths), sum(widths)):
        raise ConfigError(
            f"sensor.noise.std has {noise.std.shape[-1]} numbers: give one for each of the "
            f"{len(widths)} fields of the measurement, or for each of its {sum(widths)} numbers"
        )
    rate = 1.0 / dt if noise.rate is None else noise.rate
    told = f"sensor.noise.rate = {rate:g} Hz for {horizon:g} s"
    check_memory(told, sum(widths) * _FLOAT * rate * horizon * len(noise.seed))


def check_samples(cfg: SimulateConfig, horizon: float, sample_dt: float) -> None:
    """Raise `ConfigError` where the states of all draws, as recorded, are too many."""
    check_positive("output.sample_dt", sample_dt)
    if horizon / sample_dt > MOST_STEPS:
        raise ConfigError(
            f"horizon = {horizon:g} s sampled every {sample_dt:g} s: more than "
            f"{MOST_STEPS:.0e} samples"
        )
    plant, _ = build_plant(cfg.plant)
    check_memory(
        f"draws = {cfg.draws}, {horizon:g} s sampled every {sample_dt:g} s",
        cfg.draws * rollout_bytes(cfg, plant) * (horizon / sample_dt),
    )
