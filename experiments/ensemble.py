"""Thousands of rollouts of one scenario, with random masses and draws: how SRMSE is spread."""

from __future__ import annotations

from .command import early

if __name__ == "__main__":
    early.begin("ensemble")

import dataclasses
import shlex
import sys
import time
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

import numpy as np
from hydra.core.hydra_config import HydraConfig
from omegaconf import OmegaConf

from .building.chunks import experiment_of, run_chunk
from .building.plants import build_plant
from .building.sizes import check_rollouts
from .building.spreads import spreads
from .building.weights import MOST_DRAWS, check_draws
from .building.what_runs import LOOP_NODES, what_runs
from .command.cli import command_line, reject_unknown, run_cli
from .command.overrides import as_typed
from .command.started import as_started
from .ensembles.report import Told, write_ensembles
from .ensembles.rollouts import Chunk, Rollouts, joined
from .ensembles.summary import measures, statistics, table
from .records.recording import IDENTITY, log_summary, summary_writer, telling_settings
from .runs.life import finish
from .runs.parts import all_parts, npz_parts
from .runs.pictures import check_pictures
from .settings.checks import check_between, check_horizon
from .settings.config import ScenarioLoopConfig, title_of
from .settings.ensemble_config import EnsembleConfig
from .settings.machine import check_workers

#: Of conf/ensemble.yaml.
PAPERS_SPREAD = ("masses", 0.2)

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def main() -> None:
    """Command line of `python -m experiments.ensemble`."""
    run_cli("ensemble", checked, _task, (LOOP_NODES, what_runs))


def checked(cfg: Any) -> EnsembleConfig:
    """A composed configuration as plain dataclasses, its names, types and ranges verified."""
    reject_unknown(cfg, EnsembleConfig)
    plain = cast(EnsembleConfig, OmegaConf.to_object(cfg))
    check_between(plain, {"first": (0, MOST_DRAWS - 1), "rollouts": (1, MOST_DRAWS)})
    check_between(plain, {"chunk": (1, 10_000)})
    check_pictures(plain.output)
    check_horizon(plain.horizon)
    check_workers(plain.workers)
    plant, _ = build_plant(plain.plant)
    if plain.problem.name is not None and "masses" not in plant.fields:
        # What the file has is for the paper's plant; what anybody gives is refused.
        plain.spread = {k: v for k, v in plain.spread.items() if (k, v) != PAPERS_SPREAD}
    spreads(plain.spread, plant)
    first, last = plain.first, plain.first + plain.rollouts - 1
    check_draws(plain, range(first, last + 1))
    check_rollouts(f"chunk = {plain.chunk}", plain, plant, plain.chunk * plain.workers)
    if plain.initial.weights_file is None:
        experiment_of(plain, last, 1)
    else:  # which may lack any of them
        experiment_of(plain, first, plain.rollouts)
    return plain


def run_alone(spread: Iterable[str]) -> str:
    """The `simulate` command of one rollout, but for its draw and parameters of its own."""
    own = ("initial.draw", *(f"plant.{name}" for name in spread))
    shared = {field.name for field in dataclasses.fields(ScenarioLoopConfig)} - {"run_dir"}
    kept = []
    for override in map(as_typed, HydraConfig.get().overrides.task):
        name = override.lstrip("+~").partition("=")[0]
        if name.partition(".")[0] in shared and name not in own:
            kept.append(override)
    return shlex.join([*as_started("simulate"), *kept])


def _task(cfg: Any) -> None:
    plain = checked(cfg)
    folder = Path(HydraConfig.get().runtime.output_dir)
    start = time.perf_counter()
    end = plain.first + plain.rollouts
    chunks = {
        f"{first}_{min(plain.chunk, end - first)}": (plain, first, min(plain.chunk, end - first))
        for first in range(plain.first, end, plain.chunk)
    }
    counts = [count for _, _, count in chunks.values()]
    kept = npz_parts(Chunk, folder / "finished")
    parts = list(all_parts(run_chunk, chunks, counts, kept, plain.workers, "rollout", 1).values())
    wall_s = time.perf_counter() - start
    rollouts, command = joined(parts), command_line("ensemble")
    plant, _ = build_plant(plain.plant)
    spread = spreads(plain.spread, plant)
    title = ", ".join([title_of(plain), *(f"{n} ± {100 * s:g} %" for n, s in spread.items())])
    alone, most = run_alone(spread), max(part.peak_mb for part in parts)
    told = Told(rollouts, title, alone, plain.initial.draw)
    note = f"{wall_s:.0f} s; a process took at most {most:.0f} MB."
    figures = write_ensembles(folder, {"": told}, command, note, plain.output)
    if plain.output.tensorboard:
        _log(folder, plain, command, rollouts, figures)
    lost, units = len(rollouts) - int(rollouts.ok.sum()), rollouts.outputs[:, 1].tolist()
    record = {
        "command": command,
        "alone": alone,
        "title": title,
        "scenario": plain.scenario.name,
        "controller": plain.controller["name"],
        "keys": plain.keys.name,
        "rollouts": len(rollouts),
        "diverged": lost,
        "outputs": [{"name": name, "unit": unit} for name, unit in rollouts.outputs.tolist()],
        "measures": statistics(rollouts),
        "engine": ", ".join(sorted({part.engine for part in parts})),
        "peak_mb": most,
        "wall_s": wall_s,
        "units": {"srmse": units, "srmse_after_10s": units, "wall_s": "s", "peak_mb": "MB"},
    }
    finish(folder, record)
    print(f"{title}: {len(rollouts)} rollouts, {note}\n{table(rollouts)}")
    print(f"written to {folder}", flush=True)
    if lost:
        print(f"warning: {lost} rollouts diverged, see ensemble.md", file=sys.stderr)


def _log(
    folder: Path,
    cfg: EnsembleConfig,
    command: str,
    rollouts: Rollouts,
    figures: dict[str, Figure],
) -> None:
    """TensorBoard: the measures as histograms, their means, the settings, the picture."""
    with summary_writer(folder, command) as writer:
        for name, column in measures(rollouts).items():
            finite = column[rollouts.ok & np.isfinite(column)]
            if len(finite):
                writer.add_histogram(name, finite)
        results = {f"metrics/{k}": v["mean"] for k, v in statistics(rollouts).items()}
        log_summary(writer, telling_settings(cfg, IDENTITY), results, figures)


if __name__ == "__main__":
    main()
