"""How much memory rollouts take, told from their settings alone: nothing is allocated here."""

from __future__ import annotations

from mann_torch.control import equal_parameter_hidden
from mann_torch.errors import ConfigError
from mann_torch.plants import TwoLinkArm

from ..settings.checks import check_positive
from ..settings.config import LoopConfig, SimulateConfig
from ..settings.machine import check_memory
from ..settings.study_config import StudyConfig

#: Settings that say how large a state is: a controller and a memory.
Sized = LoopConfig | StudyConfig
_FLOAT = 8
#: A state is there at least as initial weights, as what a rollout starts from, and as its end.
_COPIES = 3
#: A run of more steps, or with more samples, is a slip of the pen.
MOST_STEPS = 1e8


def hidden_neurons(cfg: Sized) -> int:
    """N, given or such that the number of parameters equals that of a network with memory."""
    if cfg.controller.n_hidden is not None:
        return cfg.controller.n_hidden
    n = TwoLinkArm.n_joints
    slots, hidden = cfg.memory.n_slots, cfg.controller.matched_hidden
    if slots < 1 or hidden < 1:
        raise ConfigError(
            f"memory.n_slots = {slots}, controller.matched_hidden = {hidden}: at least 1"
        )
    return equal_parameter_hidden(5 * n, n, hidden, slots)


def rollout_bytes(cfg: Sized) -> float:
    """Of one state: joints, W, b_w, V, b_v, and mu and keys where there is a memory."""
    n, N = TwoLinkArm.n_joints, hidden_neurons(cfg)
    slots = cfg.memory.n_slots if cfg.controller.attention is not None else 0
    return float(_FLOAT * (2 * n + n * (N + 1) + N * (5 * n + 1) + slots * (N + n)))


def check_rollouts(what: str, cfg: Sized, count: int) -> None:
    """Raise `ConfigError` where `count` rollouts side by side do not fit the machine."""
    sizes = f"controller.n_hidden = {hidden_neurons(cfg)}"
    if cfg.controller.attention is not None:
        sizes += f", memory.n_slots = {cfg.memory.n_slots}"
    check_memory(f"{what} with {sizes}", _COPIES * count * rollout_bytes(cfg))


def check_steps(horizon: float, dt: float) -> None:
    """Raise `ConfigError` where a horizon [s] has too many steps of `dt` [s] for a grid."""
    if horizon / dt > MOST_STEPS:
        raise ConfigError(
            f"horizon = {horizon:g} s in steps of solver.dt = {dt:g} s: more than "
            f"{MOST_STEPS:.0e} steps"
        )
    check_memory(f"horizon = {horizon:g} s", 3 * _FLOAT * horizon / dt)


def check_noise(what: str, instants: float, streams: int) -> None:
    """Raise `ConfigError` where the numbers behind measurement noise are too many."""
    check_memory(what, 2 * TwoLinkArm.n_joints * _FLOAT * instants * streams)


def check_samples(cfg: SimulateConfig, horizon: float, sample_dt: float) -> None:
    """Raise `ConfigError` where the states of all draws, as recorded, are too many."""
    check_positive("output.sample_dt", sample_dt)
    if horizon / sample_dt > MOST_STEPS:
        raise ConfigError(
            f"horizon = {horizon:g} s sampled every {sample_dt:g} s: more than "
            f"{MOST_STEPS:.0e} samples"
        )
    check_memory(
        f"draws = {cfg.draws}, {horizon:g} s sampled every {sample_dt:g} s",
        cfg.draws * rollout_bytes(cfg) * (horizon / sample_dt),
    )
