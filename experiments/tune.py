"""Tune design constants by gradient, and judge them where they were not tuned."""

from __future__ import annotations

from .command import early

if __name__ == "__main__":
    early.begin("tune")

import math
import time
from collections.abc import Sequence
from contextlib import nullcontext
from dataclasses import asdict
from pathlib import Path
from typing import Any, cast

import numpy as np
import torch
from hydra.core.hydra_config import HydraConfig
from omegaconf import OmegaConf

from mann_torch.errors import ConfigError
from mann_torch.simulation.step_grid import StepGrid
from mann_torch.tuning import Coordinates, Ensemble, GradientSettings, Objective, Schedule, Tuner

from .building.ensembles import check_names, scenarios_of, tuned_ensemble
from .building.what_runs import LOOP_NODES, what_runs
from .command.cli import command_line, reject_unknown, run_cli
from .records.recording import Writer, log_summary, summary_writer, telling_settings
from .runs import checkpoints
from .runs.life import finish
from .runs.pictures import check_pictures, linked, save_all
from .runs.progress import progress_bar
from .runs.writing import csv_text, write_json, write_text
from .settings.checks import check_between, check_positive
from .settings.study_config import TuneConfig
from .tuning import held_out
from .tuning.figures import pareto, progress_curves
from .tuning.held_out import START, TUNED, Candidate
from .tuning.report import report_of, signals_of
from .tuning.sizes import check_sizes


def main() -> None:
    """Command line of `python -m experiments.tune`."""
    run_cli("tune", checked, _task, (LOOP_NODES, what_runs))


def checked(cfg: Any) -> TuneConfig:
    """A composed configuration as plain dataclasses, everything verified, nothing computed.

    With `resume`, the configuration that run was started with.
    """
    reject_unknown(cfg, TuneConfig)
    plain = cast(TuneConfig, OmegaConf.to_object(cfg))
    check_pictures(plain.output)
    if plain.resume is not None:
        folder = Path(plain.resume)
        plain = checkpoints.saved_config(folder)
        plain.resume = str(folder)
        _restored(tuner_of(plain), folder)
    tuner = tuner_of(plain)
    _, others, grid = _candidates(plain, tuner)
    check_sizes(plain, tuner, 2 + len(others) + len(grid))
    return plain


def tuner_of(cfg: TuneConfig) -> Tuner:
    """The tuner of a configuration. Raises `ConfigError`."""
    check_names("train", cfg.train.scenarios, cfg.train.draws)
    ensemble = tuned_ensemble(cfg, scenarios_of(cfg, cfg.train), cfg.train.draws)
    shared = [name for name in cfg.names if name in ensemble.own]
    if shared:
        raise ConfigError(
            f"names: {', '.join(shared)} differ between train.scenarios: give one in `start`"
        )
    coordinates = Coordinates(ensemble.loop, cfg.names, cfg.matrix_form)
    schedule = asdict(cfg.schedule)
    try:
        schedule["curriculum"] = [(int(a), float(b)) for a, b in cfg.schedule.curriculum]
    except (TypeError, ValueError):
        raise ConfigError(
            f"schedule.curriculum = {cfg.schedule.curriculum}: give [iteration, horizon] pairs"
        ) from None
    return Tuner(
        ensemble,
        coordinates,
        Objective(**asdict(cfg.objective)),
        GradientSettings(**asdict(cfg.gradient)),
        Schedule(**schedule, seed=cfg.seed),
        begin=_begin(cfg, coordinates.size),
    )


def _begin(cfg: TuneConfig, size: int) -> torch.Tensor | None:
    """Where a restart begins: log factors, uniform; None for the constants themselves."""
    check_between(cfg, {"restart": (0, 2**31), "seed": (0, 2**32 - 1)})
    check_positive("restart_spread", cfg.restart_spread)
    if cfg.restart == 0:
        return None
    unit = np.random.default_rng([cfg.seed, cfg.restart]).uniform(-1.0, 1.0, size)
    return torch.from_numpy(math.log1p(cfg.restart_spread) * unit)


def _restored(tuner: Tuner, folder: Path) -> Tuner:
    state = checkpoints.load(folder)
    if state is not None:
        tuner.load_state_dict(state)
    return tuner


def _candidates(
    cfg: TuneConfig, tuner: Tuner
) -> tuple[dict[str, Ensemble], list[Candidate], list[Candidate]]:
    """Held-out ensembles, compared candidates and grid. Raises `ConfigError`."""
    ensembles = held_out.held_out_ensembles(cfg, cfg.held_out)
    if not cfg.judge:
        ensembles = {}
    others = held_out.compared(cfg.compare)
    grid = held_out.grid_candidates(held_out.with_own(cfg.grid, tuner.ensemble.loop))
    held_out.check_candidates(tuner.ensemble, [*others, *grid])
    return ensembles, others, grid


def _task(cfg: Any) -> None:
    plain = checked(cfg)
    folder = Path(HydraConfig.get().runtime.output_dir)
    tuner = _restored(tuner_of(plain), folder)
    if not (folder / "command.txt").exists():
        write_text(folder / "command.txt", command_line("tune") + "\n")
    command = (folder / "command.txt").read_text().strip()
    start = time.perf_counter()
    with summary_writer(folder, command) if plain.output.tensorboard else nullcontext() as writer:
        for record in tuner.history:
            _log(writer, tuner, record)
        _tune(tuner, folder, writer)
        tuning_s = time.perf_counter() - start
        values = tuner.values()
        write_json(
            folder / "constants.json",
            {"constants": {name: v.tolist() for name, v in values.items()}, "command": command},
        )
        ensembles, others, grid = _candidates(plain, tuner)
        candidates = [Candidate(START, {}), Candidate(TUNED, values), *others, *grid]
        scores = _judge(ensembles, candidates)
        chosen = [TUNED, *(candidate.name for candidate in others)]
        verdicts = held_out.verdicts(scores, candidates, chosen)
        labels = tuner.coordinates.labels
        starts = [_shown(tuner.coordinates.starts()[label.split("[")[0]]) for label in labels]
        figures = {}
        if plain.output.figures:
            figures["progress"] = progress_curves(tuner.history, labels, starts)
        if plain.output.figures and scores:
            title = f"trained on {', '.join(scenarios_of(plain, plain.train))}"
            figures["pareto"] = pareto(scores, candidates, chosen, title)
        save_all(folder, figures, plain.output)
        results = {"metrics/objective": tuner.history[-1]["objective"]}
        results |= {
            f"metrics/held_out_srmse_percent_{v.scenario}": v.srmse.mean
            for v in verdicts
            if v.candidate == TUNED
        }
        if writer is not None:
            log_summary(writer, telling_settings(plain), results, figures)
    report = report_of(tuner, verdicts, command, tuning_s)
    write_text(folder / "report.md", report + linked(figures, plain.output))
    write_text(folder / "held_out.csv", csv_text(held_out.rows(scores, candidates)))
    finish(
        folder,
        {
            "command": command,
            "tuning_s": tuning_s,
            "constants": {name: v.tolist() for name, v in values.items()},
            "gradient": {label: asdict(s) for label, s in signals_of(tuner).items()},
            "silent": tuner.silent(),
            "held_out": [asdict(v) for v in verdicts],
            "history": tuner.history,
        },
    )
    print(report)
    print(f"written to {folder}", flush=True)


def _tune(tuner: Tuner, folder: Path, writer: Writer | None) -> None:
    """All iterations that are left; a checkpoint after each."""
    with progress_bar(tuner.schedule.iterations, "iteration") as bar:
        bar.update(tuner.iteration)
        while not tuner.done:
            record = tuner.step()
            checkpoints.save(folder, tuner.state_dict())
            _log(writer, tuner, record)
            bar.set_postfix(objective=f"{record['objective']:.4f}")
            bar.update()


def _log(writer: Writer | None, tuner: Tuner, record: dict[str, Any]) -> None:
    """One iteration's curves, where they are wanted."""
    if writer is None:
        return
    step, labels = record["iteration"], tuner.coordinates.labels
    writer.add_scalar("tune/objective", record["objective"], step)
    for label, z, slope in zip(labels, record["z"], record["gradient"], strict=True):
        writer.add_scalar(f"log_change/{label}", z, step)
        writer.add_scalar(f"gradient/{label}", slope, step)


def _judge(ensembles: dict[str, Ensemble], candidates: Sequence[Candidate]) -> dict[str, Any]:
    steps = {}
    for name, ensemble in ensembles.items():
        grid = StepGrid(ensemble.scenario.end, ensemble.scenario.knots(), ensemble.solver.dt)
        steps[name] = grid.n_steps
    with progress_bar(sum(steps.values()), "step") as bar:
        return {
            name: held_out.evaluate(ensemble, candidates, bar.update)
            for name, ensemble in ensembles.items()
        }


def _shown(start: torch.Tensor) -> float:
    return float(start.reshape(-1)[0])


if __name__ == "__main__":
    main()
