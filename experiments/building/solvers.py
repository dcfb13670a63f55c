"""The solver of a configuration."""

from __future__ import annotations

from mann_torch import Implicit, Odeint, RungeKutta, Solver
from mann_torch.errors import ConfigError
from mann_torch.simulation import ADAPTIVE, FIXED, SOLVERS

from ..settings.config import SolverConfig

#: Settings that only some solvers take.
_SOLVER_SETTINGS = {
    "rtol": (*ADAPTIVE, "scipy_solver"),
    "atol": (*ADAPTIVE, "scipy_solver"),
    "max_step": FIXED,
    "follow_reference": ("implicit",),
}


def build_solver(cfg: SolverConfig) -> Solver:
    """The solver of that name. Raises `ConfigError`, for a setting that it would ignore too."""
    if cfg.name not in SOLVERS:
        raise ConfigError(f"unknown solver '{cfg.name}'; choose from {', '.join(SOLVERS)}")
    for name, takers in _SOLVER_SETTINGS.items():
        value = getattr(cfg, name)
        if cfg.name not in takers and value != getattr(SolverConfig, name):
            raise ConfigError(
                f"solver.{name} = {value}: {cfg.name} takes none; {', '.join(takers)} would"
            )
    if cfg.name == "implicit":
        return Implicit(cfg.dt, cfg.compile, cfg.follow_reference)
    if cfg.name == "runge_kutta":
        return RungeKutta(cfg.dt, cfg.compile)
    inner = None if cfg.max_step is None else min(cfg.max_step, cfg.dt)
    return Odeint(cfg.name, cfg.dt, cfg.rtol, cfg.atol, inner, compile=cfg.compile)
