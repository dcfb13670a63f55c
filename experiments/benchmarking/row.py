"""One line of the benchmark: `python -m experiments.benchmarking.row JSON`, in its own process."""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from typing import Any, cast

import torch
from omegaconf import OmegaConf
from torch import Tensor

import mann_torch as mt

from ..building.build import Experiment, build
from ..command.cli import compose_job
from ..runs.workers import peak_mb
from ..settings.config import SimulateConfig

#: The controller that every engine runs: smooth, so that all must reach the same figure.
SMOOTH = "soft"
#: The paper's.
PAPER = "reallocating_initial"
#: The constants that gradients go to where not all are asked for.
CONSTANTS = (
    *("error_gain", "base_gain", "robust_gain"),
    *("rate_W", "rate_V", "e_modification", "write_gain"),
)
#: Engines of `rollout` and their solver, where it is not the default.
TORCH: dict[str, mt.Solver] = {
    "eager": mt.Implicit(),
    "torch.compile": mt.Implicit(compile=True),
    "dopri5": mt.Odeint("dopri5", dt=4e-3, rtol=1e-5),
    "rk4": mt.Odeint("rk4", dt=4e-3, max_step=2e-4),
}
JAX = ("jax scan", "diffrax Tsit5")
Runs = tuple[Callable[[], Tensor], Callable[[], Tensor]]


@dataclass(frozen=True)
class Line:
    """An engine at one batch size. Times are simulated seconds; gradient 0: none is taken."""

    engine: str
    batch: int
    forward: float
    gradient: float
    repeats: int = 1
    loop: str = SMOOTH


def experiment(batch: int, horizon: float, loop: str = SMOOTH, scenario: str = "1") -> Experiment:
    """`batch` draws of a scenario under a controller."""
    overrides = [
        f"scenario='{scenario}'",
        f"controller={loop}",
        f"draws={batch}",
        f"horizon={horizon}",
    ]
    return build(cast(SimulateConfig, OmegaConf.to_object(compose_job("simulate", overrides))))


def run(
    engine: str, made: Experiment, gradient: str = "plain", motion_dt: float | None = 0.1
) -> mt.Trajectory:
    """One rollout on an engine of this package."""
    return mt.rollout(
        made.loop,
        made.scenario,
        TORCH.get(engine, made.solver),
        weights=made.weights,
        engine="torch" if engine in TORCH else "compiled",
        device="cuda" if engine == "compiled cuda" else "cpu",
        motion_dt=motion_dt,
        sample_until=0.0,
        gradient=gradient,
    )


def smooth_constants(made: Experiment) -> list[str]:
    """The names of all constants with a gradient: theta is compared with, no more."""
    return [name for name in made.loop.controller.constants() if name != "shift_threshold"]


def error_of(engine: str, made: Experiment, gradient: str = "plain") -> Tensor:
    """SRMSE (B, n) of a rollout without gradients."""
    with torch.no_grad():
        return mt.srmse(run(engine, made, gradient))


def slope_of(
    engine: str, made: Experiment, names: Sequence[str], gradient: str = "plain"
) -> tuple[Tensor, list[Tensor]]:
    """SRMSE (B, n) of a rollout and its gradients to the named constants."""
    free = made.loop.controller.tune(*names)
    found = mt.srmse(run(engine, made, gradient))
    return found.detach(), list(torch.autograd.grad(found.sum(), free))


def _torch_runs(line: Line, horizon: float) -> Runs:
    made = experiment(line.batch, horizon, line.loop)
    names = smooth_constants(made)
    return (
        lambda: error_of(line.engine, made),
        lambda: slope_of(line.engine, made, names)[0],
    )


def _jax_runs(line: Line, horizon: float) -> Runs:
    import jax
    import numpy as np

    from .peer_jax import Peer

    peer = Peer(experiment(line.batch, horizon), horizon)
    srmse = peer.implicit() if line.engine == "jax scan" else peer.tsit5()
    slope = jax.jit(jax.value_and_grad(lambda c: srmse(c).sum()))

    def forward() -> Tensor:
        return torch.from_numpy(np.array(srmse(peer.constants).block_until_ready()))

    def both() -> Tensor:
        value, gradients = slope(peer.constants)
        jax.block_until_ready(gradients)
        return torch.from_numpy(np.array(value))

    return forward, both


def _time(run: Callable[[], Tensor], repeats: int) -> tuple[float, Tensor]:
    best, found = float("inf"), torch.empty(0)
    for _ in range(repeats):
        start = time.perf_counter()
        found = run()
        best = min(best, time.perf_counter() - start)
    return best, found


def measure(line: Line) -> dict[str, Any]:
    """Seconds per simulated second and trajectory, compile time, SRMSE, peak memory."""
    if line.engine in TORCH:
        torch.set_num_threads(1)  # one thread beats two at these sizes
    runs = _jax_runs if line.engine in JAX else _torch_runs
    warm = line.engine not in ("eager", "dopri5", "rk4")
    start = time.perf_counter()
    forward, _ = runs(line, line.forward)
    if warm:  # JAX compiles for a horizon, the others for any
        (forward if runs is _jax_runs else runs(line, 0.02)[0])()
    first = time.perf_counter() - start
    seconds, srmse = _time(forward, line.repeats)
    result = {
        **asdict(line),
        "srmse": srmse[0].tolist(),
        "forward_s": seconds / (line.forward * line.batch),
        "compile_s": max(first - seconds, 0.0) if runs is _jax_runs else first if warm else 0.0,
    }
    if line.gradient > 0:
        forward, both = runs(line, line.gradient)
        start = time.perf_counter()
        if warm:
            (both if runs is _jax_runs else runs(line, 0.02)[1])()
        result["gradient_compile_s"] = time.perf_counter() - start if warm else 0.0
        if runs is _jax_runs:
            forward()
        here, _ = _time(forward, line.repeats)
        seconds, _ = _time(both, line.repeats)
        result["both_s"] = seconds / (line.gradient * line.batch)
        result["both_over_forward"] = seconds / here
    result["peak_mb"] = peak_mb()
    return result


if __name__ == "__main__":
    print(json.dumps(measure(Line(**json.loads(sys.argv[1])))))
