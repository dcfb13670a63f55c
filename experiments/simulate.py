"""Simulate one or many draws of one scenario under one controller."""

from __future__ import annotations

from .command import early

if __name__ == "__main__":
    early.begin("simulate")

import sys
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

import torch
from hydra.core.hydra_config import HydraConfig
from omegaconf import OmegaConf

from mann_torch import Trajectory, memory_figure, rollout
from mann_torch.control import AdaptiveNetwork
from mann_torch.errors import ConfigError
from mann_torch.simulation import check_engine
from mann_torch.simulation.step_grid import StepGrid

from .animations.every import check_animation
from .animations.files import animate
from .animations.motion import motion_of
from .building.build import Experiment, build
from .building.schedules import late_changes
from .building.sizes import check_samples
from .building.weights import check_draws
from .building.what_runs import LOOP_NODES, what_runs
from .command.cli import command_line, reject_unknown, run_cli
from .records.arrays import signal_arrays
from .records.recording import channels_of, log_run, metrics_of, units_of
from .runs.figures import Arrays, hidden_states, inputs, of_draws, outputs, traces, with_unit
from .runs.life import finish
from .runs.memory_figures import attends, attention_timeline, features_and_read, with_resets
from .runs.pictures import check_pictures, save_all
from .runs.progress import progress_bar
from .runs.writing import write_arrays
from .settings.checks import check_horizon
from .settings.config import SimulateConfig, title_of

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def main() -> None:
    """Command line of `python -m experiments.simulate`."""
    run_cli("simulate", checked, _task, (LOOP_NODES, what_runs))


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
    check_animation(output, {plain.plant["name"]: build(plain).loop.plant})
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
    """The standard pictures of one draw of a run, those of a memory where there is one."""
    run = of_draws(arrays, member)
    runs = {name: run}
    figures = {"outputs": outputs(runs, title), "inputs": inputs(runs, title)}
    others, adaptive = hidden_states(run), run["adaptive"].tolist()
    if others:
        figures["states"] = traces(run, others, title)
    if "hidden" in run and run["hidden"].ndim == 2:
        figures["features_and_read"] = features_and_read(runs, title)
    elif adaptive:
        figures["controller"] = traces(run, adaptive, title)
    if attends(run):
        figures["attention"] = attention_timeline(runs, title)
        if "mu" in run:
            resets = {name: with_resets(run)}
            figures["memory"] = memory_figure(resets, run["t"], title, (), "t [s]")
    return figures


def summary(metrics: Mapping[str, Any], channels: Sequence[Mapping[str, str]]) -> str:
    """The run's table, a line a draw: SRMSE in a column for each output."""
    table = [["draw", *map(str, range(len(metrics["status"])))]]
    heads = [with_unit(f"SRMSE x 10^3, {each['name']}", each["unit"]) for each in channels]
    late = [f"{each['name']} after 10 s" for each in channels]
    for key, names in (("srmse", heads), ("srmse_after_10s", late)):
        for name, values in zip(names, zip(*metrics[key], strict=True), strict=True):
            table.append([name, *(f"{1e3 * value:.3f}" for value in values)])
    table += [[name, *map(str, metrics[name])] for name in ("reallocations", "switches")]
    columns = [[text.rjust(max(map(len, column))) for text in column] for column in table]
    columns.append(["status", *metrics["status"]])
    return "\n".join("  ".join(row) for row in zip(*columns, strict=True))


def _task(cfg: Any) -> None:
    plain = checked(cfg)
    folder = Path(HydraConfig.get().runtime.output_dir)
    command = command_line("simulate")
    late = late_changes(plain.scenario, plain.horizon)
    if late is not None:
        print(f"warning: {late}", file=sys.stderr)
    experiment, trajectory, wall_s = simulate(plain)
    with torch.inference_mode():
        metrics = metrics_of(trajectory)
        arrays = signal_arrays(experiment.loop, experiment.scenario, trajectory)
    title = title_of(plain)
    channels = channels_of(trajectory)
    record = {
        **metrics,
        "wall_s": wall_s,
        "scenario": plain.scenario.name,
        "plant": plain.plant["name"],
        "controller": plain.controller["name"],
        "keys": plain.keys.name,
        "solver": trajectory.solver,
        "engine": trajectory.engine,
        "engine_reason": trajectory.engine_reason,
        **channels,
        "units": units_of(trajectory),
        "command": command,
    }
    write_arrays(folder / "trajectory.npz", arrays)
    figures = {}
    if plain.output.figures:
        figures = run_figures(title, plain.controller["name"], arrays, plain.output.member)
    save_all(folder, figures, plain.output)
    if plain.output.animation:
        member, plant = plain.output.member, experiment.loop.plant
        motion = motion_of(plant, experiment.scenario, of_draws(arrays, member), member)
        animate(folder / "animation", plain.output, motion, title)
    if plain.output.tensorboard:
        log_run(folder, plain, arrays, metrics, figures, command)
    finish(folder, record)
    network = getattr(experiment.loop.controller, "network", None)
    neurons = f", {network.n_hidden} neurons" if isinstance(network, AdaptiveNetwork) else ""
    print(f"{title}{neurons}, {trajectory.solver} ({trajectory.engine}), {wall_s:.1f} s")
    print(summary(metrics, channels["outputs"]))
    print(f"written to {folder}", flush=True)
    if any(status != "ok" for status in metrics["status"]):
        print("warning: a draw diverged; its SRMSE is null in metrics.json", file=sys.stderr)


if __name__ == "__main__":
    main()
