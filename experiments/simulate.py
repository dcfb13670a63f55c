"""Simulate one or many draws of one scenario under one controller."""

from __future__ import annotations

from .command import early

if __name__ == "__main__":
    early.begin("simulate")

import sys
import time
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

import torch
from hydra.core.hydra_config import HydraConfig
from omegaconf import OmegaConf

from mann_torch import Trajectory, memory_figure, rollout
from mann_torch.errors import ConfigError
from mann_torch.simulation import check_engine
from mann_torch.simulation.step_grid import StepGrid

from .building.build import Experiment, build
from .building.schedules import late_changes
from .building.sizes import check_samples
from .building.weights import check_draws
from .command.cli import command_line, reject_unknown, run_cli
from .records.recording import log_run, metrics_of, signal_arrays
from .runs.figures import (
    Arrays,
    attention_timeline,
    features_and_read,
    joint_angles,
    one_draw,
    torques,
    with_resets,
)
from .runs.life import finish
from .runs.pictures import check_pictures, save_all
from .runs.progress import progress_bar
from .runs.writing import write_arrays
from .settings.checks import check_horizon
from .settings.config import SimulateConfig

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def main() -> None:
    """Command line of `python -m experiments.simulate`."""
    run_cli("simulate", checked, _task)


def checked(cfg: Any) -> SimulateConfig:
    """A composed configuration as plain dataclasses, its names, types and ranges verified."""
    reject_unknown(cfg, SimulateConfig)
    plain = cast(SimulateConfig, OmegaConf.to_object(cfg))
    output = plain.output
    check_pictures(output)
    check_draws(plain, range(plain.draws))
    if not 0 <= output.member < plain.draws:
        raise ConfigError(f"output.member = {output.member}: there are {plain.draws} draws, from 0")
    check_horizon(plain.horizon)
    horizon = plain.scenario.horizon if plain.horizon is None else plain.horizon
    check_samples(plain, horizon, output.sample_dt)
    build(plain)
    return plain


def simulate(cfg: SimulateConfig) -> tuple[Experiment, Trajectory, float]:
    """Run the configured rollout; returns experiment, trajectory and wall time [s]."""
    experiment = build(cfg)
    scenario, solver = experiment.scenario, experiment.solver
    engine, device = cfg.solver.engine, cfg.solver.device
    if check_engine(experiment.loop, scenario, solver, engine, device) is not None:
        torch.set_num_threads(1)  # in torch one thread beats two at these sizes
    steps = StepGrid(scenario.end, scenario.knots(), solver.dt).n_steps
    start = time.perf_counter()
    with torch.inference_mode(), progress_bar(steps, "step") as bar:
        trajectory = rollout(
            experiment.loop,
            scenario,
            solver,
            weights=experiment.weights,
            sample_dt=cfg.output.sample_dt,
            engine=engine,
            device=device,
            progress=bar.update,
        )
    return experiment, trajectory, time.perf_counter() - start


def run_figures(title: str, name: str, arrays: Arrays, member: int) -> dict[str, Figure]:
    """The standard pictures of one draw of a run."""
    run = one_draw(arrays, member)
    runs = {name: run}
    figures = {"joint_angles": joint_angles(runs, title)}
    figures["torques"] = torques(runs, title)
    figures["features_and_read"] = features_and_read(runs, title)
    if "attended" in run:
        figures["attention"] = attention_timeline(runs, title)
        figures["memory"] = memory_figure({name: with_resets(run)}, run["t"], title, (), "t [s]")
    return figures


def summary(metrics: Mapping[str, Any]) -> str:
    """The run's table, a line a draw."""
    lines = ["draw  SRMSE x 10^3 [rad]    after 10 s        reallocations  switches  status"]
    for draw, status in enumerate(metrics["status"]):
        a, b = (1e3 * value for value in metrics["srmse"][draw])
        c, d = (1e3 * value for value in metrics["srmse_after_10s"][draw])
        lines.append(
            f"{draw:>4}  {a:9.3f} {b:9.3f}  {c:9.3f} {d:9.3f}"
            f"  {metrics['reallocations'][draw]:>12}  {metrics['switches'][draw]:>8}  {status}"
        )
    return "\n".join(lines)


def _task(cfg: Any) -> None:
    plain = checked(cfg)
    folder = Path(HydraConfig.get().runtime.output_dir)
    command = command_line("experiments.simulate")
    late = late_changes(plain.scenario, plain.horizon)
    if late is not None:
        print(f"warning: {late}", file=sys.stderr)
    experiment, trajectory, wall_s = simulate(plain)
    with torch.inference_mode():
        metrics = metrics_of(trajectory)
        arrays = signal_arrays(experiment.loop, experiment.scenario, trajectory)
    title = f"scenario {plain.scenario.name}, {plain.controller['name']}, {plain.keys.name} keys"
    record = {
        **metrics,
        "wall_s": wall_s,
        "scenario": plain.scenario.name,
        "controller": plain.controller["name"],
        "keys": plain.keys.name,
        "solver": trajectory.solver,
        "engine": trajectory.engine,
        "engine_reason": trajectory.engine_reason,
        "units": {"srmse": "rad", "srmse_after_10s": "rad", "wall_s": "s"},
        "command": command,
    }
    write_arrays(folder / "trajectory.npz", arrays)
    figures = {}
    if plain.output.figures:
        figures = run_figures(title, plain.controller["name"], arrays, plain.output.member)
    save_all(folder, figures, plain.output)
    if plain.output.tensorboard:
        log_run(folder, plain, arrays, metrics, figures, command)
    finish(folder, record)
    print(f"{title}, {trajectory.solver} ({trajectory.engine}), {wall_s:.1f} s")
    print(summary(metrics))
    print(f"written to {folder}", flush=True)
    if any(status != "ok" for status in metrics["status"]):
        print("warning: a draw diverged; its SRMSE is null in metrics.json", file=sys.stderr)


if __name__ == "__main__":
    main()
