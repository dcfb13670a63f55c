"""One line of the benchmark: `python -m experiments.benchmark_row JSON`, in its own process."""

from __future__ import annotations

import json
import resource
import sys
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass
from typing import Any, cast

import torch
from omegaconf import OmegaConf
from torch import Tensor

import mann_torch as mt

from .build import Experiment, build
from .cli import compose_job
from .config import SimulateConfig

#: The loop that every engine runs: smooth, so that all must reach the same figure.
LOOP = ("scenario='1'", "controller=soft")


@dataclass(frozen=True)
class Line:
    """An engine at one batch size. Times are simulated seconds; gradient 0: none is taken."""

    engine: str
    batch: int
    forward: float
    gradient: float
    repeats: int = 1


def experiment(batch: int, horizon: float) -> Experiment:
    """`batch` draws of the benchmark's loop."""
    overrides = [*LOOP, f"draws={batch}", f"horizon={horizon}"]
    return build(cast(SimulateConfig, OmegaConf.to_object(compose_job("simulate", overrides))))


def _rollout(engine: str, made: Experiment) -> mt.Trajectory:
    solvers: dict[str, mt.Solver] = {
        "eager": mt.Implicit(),
        "compiled": mt.Implicit(compile=True),
        "dopri5": mt.Odeint("dopri5", dt=4e-3, rtol=1e-5),
        "rk4": mt.Odeint("rk4", dt=4e-3, max_step=2e-4),
    }
    return mt.rollout(
        made.loop,
        made.scenario,
        solvers.get(engine, made.solver),
        network=made.network,
        engine="torch" if engine in solvers else "fused",
        device="cuda" if engine == "fused cuda" else "cpu",
        motion_dt=0.1,
        sample_until=0.0,
    )


def _torch_runs(line: Line, horizon: float) -> tuple[Callable[[], Tensor], Callable[[], Tensor]]:
    made = experiment(line.batch, horizon)
    controller = made.loop.controller

    def forward() -> Tensor:
        with torch.no_grad():
            return mt.srmse(_rollout(line.engine, made))

    def both() -> Tensor:
        free = controller.tune(*(n for n in controller.constants() if n != "shift_threshold"))
        found = mt.srmse(_rollout(line.engine, made))
        torch.autograd.grad(found.sum(), free)
        return found.detach()

    return forward, both


def _jax_runs(line: Line, horizon: float) -> tuple[Callable[[], Tensor], Callable[[], Tensor]]:
    import jax
    import numpy as np

    from .benchmark_jax import Peer

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
    if line.engine in ("eager", "compiled", "dopri5", "rk4"):
        torch.set_num_threads(1)  # one thread beats two at these sizes
    runs = _jax_runs if line.engine in ("jax scan", "diffrax Tsit5") else _torch_runs
    warm = line.engine in ("compiled", "jax scan", "diffrax Tsit5", "fused", "fused cuda")
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
    result["peak_mb"] = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    return result


if __name__ == "__main__":
    print(json.dumps(measure(Line(**json.loads(sys.argv[1])))))
