"""Can the gradients be trusted? Every mode against differences, for one scenario."""

from __future__ import annotations

from .command import early

if __name__ == "__main__":
    early.begin("gradient_report")

import dataclasses
import math
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

from hydra.core.hydra_config import HydraConfig
from omegaconf import OmegaConf

from mann_torch.errors import ConfigError
from mann_torch.tuning import Coordinates, Ensemble

from .building.controllers import paper_constants
from .building.ensembles import ensemble_of
from .building.plants import build_plant
from .building.sizes import check_rollouts
from .building.what_runs import LOOP_NODES, what_runs
from .command.cli import command_line, reject_unknown, run_cli
from .gradients.elasticities import Findings, difference_name, estimate_all, pathwise_modes
from .gradients.figures import landscapes, norms
from .records.recording import log_summary, summary_writer, telling_settings
from .runs.figures import with_unit
from .runs.life import finish
from .runs.pictures import check_pictures, linked, save_all
from .runs.progress import progress_bar
from .runs.writing import csv_text, write_text
from .settings.config import ScenarioLoopConfig, SimulateConfig, title_of
from .settings.study_config import GradientReportConfig

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def main() -> None:
    """Command line of `python -m experiments.gradient_report`."""
    run_cli("gradient_report", lambda cfg: checked(cfg), _task, (LOOP_NODES, what_runs))


def checked(cfg: Any) -> tuple[GradientReportConfig, Ensemble, Coordinates]:
    """A composed configuration, everything verified, nothing computed."""
    reject_unknown(cfg, GradientReportConfig)
    plain = cast(GradientReportConfig, OmegaConf.to_object(cfg))
    check_pictures(plain.output)
    if plain.draws < 2:
        raise ConfigError(f"draws = {plain.draws}: at least 2, for an interval")
    if plain.pairs < 1:
        raise ConfigError(f"pairs = {plain.pairs}: at least 1")
    if plain.judge not in plain.steps:
        raise ConfigError(f"judge = {plain.judge}: choose one of steps = {plain.steps}")
    for name, numbers in (
        ("steps", plain.steps),
        ("spread", [plain.spread]),
        ("temperatures", plain.temperatures),
        ("horizons", plain.horizons),
    ):
        if not all(math.isfinite(number) and number > 0 for number in numbers):
            raise ConfigError(f"{name} = {numbers}: must be finite and > 0")
    if max(plain.spread, *plain.steps) >= 2:
        raise ConfigError("steps and spread are relative: below 2")
    shared = [field.name for field in dataclasses.fields(ScenarioLoopConfig)]
    simulated = SimulateConfig(**{name: getattr(plain, name) for name in shared})
    plant, _ = build_plant(plain.plant)
    if not 0 <= plain.of_output <= len(plant.outputs):
        raise ConfigError(
            f"of_output = {plain.of_output}: 1 to {len(plant.outputs)}, or 0 for all together"
        )
    copies = 2 * len(plain.names) * max(plain.pairs, 1)
    check_rollouts(
        f"draws = {plain.draws}, pairs = {plain.pairs}", plain, plant, copies * plain.draws
    )
    ensemble = ensemble_of(plain, [simulated], range(plain.draws))
    ensemble = dataclasses.replace(ensemble, effort_after=None)
    loop = ensemble.loop
    names = [name for name in plain.names if name in loop.constants()]
    for name in (*plain.names, *plain.control):
        if name not in paper_constants():
            loop.constant(name)  # says which there are; one that only this lacks is left out
    return plain, ensemble, Coordinates(loop, names, "scalar")


def _task(cfg: Any) -> None:
    plain, ensemble, coordinates = checked(cfg)
    folder = Path(HydraConfig.get().runtime.output_dir)
    command = command_line("gradient_report")
    start = time.perf_counter()
    modes = [mode for mode in pathwise_modes(ensemble) if mode != "soft"]
    stages = 2 + len(modes) + len(plain.steps) + len(plain.temperatures) + 1
    stages += sum(horizon < ensemble.scenario.end for horizon in plain.horizons)
    with progress_bar(stages, "stage") as bar:

        def progress(stage: str) -> None:
            bar.set_postfix_str(stage)
            bar.update()

        findings = estimate_all(plain, ensemble, coordinates, progress)
    wall_s = time.perf_counter() - start
    title = title_of(plain)
    figures: dict[str, Figure] = {}
    if plain.output.figures:
        figures = {"landscape": landscapes(findings, title), "norms": norms(findings, title)}
    save_all(folder, figures, plain.output)
    report = _report(plain, findings, title, command, wall_s) + linked(figures, plain.output)
    write_text(folder / "report.md", report)
    header, *rows = _rows(findings)
    write_text(folder / "elasticities.csv", csv_text([header, *rows]))
    results = {
        f"elasticity/{label}/{estimate.mode}": interval.mean
        for estimate in findings.estimates
        for label, interval in zip(findings.labels, estimate.intervals, strict=True)
    }
    if plain.output.tensorboard:
        with summary_writer(folder, command) as writer:
            log_summary(writer, telling_settings(plain), results, figures)
    finish(
        folder,
        {
            "command": command,
            "wall_s": wall_s,
            "scenario": plain.scenario.name,
            "controller": plain.controller["name"],
            "outputs": [channel._asdict() for channel in findings.outputs],
            "srmse": findings.srmse,
            "switches": findings.switches,
            "reallocations": findings.reallocations,
            "elasticities": [dict(zip(header, row, strict=True)) for row in rows],
            "norms": findings.norms,
            "events": findings.events,
        },
    )
    print(report)
    print(f"written to {folder}", flush=True)


def _rows(findings: Findings) -> list[list[Any]]:
    rows: list[list[Any]] = [["constant", "mode", "elasticity", "half_width_95", "verdict"]]
    for coordinate, label in enumerate(findings.labels):
        for estimate in findings.estimates:
            interval = estimate.intervals[coordinate]
            said = "" if estimate.mode == findings.judge else findings.verdict(estimate, coordinate)
            rows.append([label, estimate.mode, interval.mean, interval.half, said])
    return rows


def _report(
    cfg: GradientReportConfig, findings: Findings, title: str, command: str, wall_s: float
) -> str:
    judge = difference_name(cfg.judge)
    outputs = " and ".join(channel.name for channel in findings.outputs)
    mean = sum(findings.srmse) / len(findings.srmse)
    of = with_unit("SRMSE x 10^3", findings.unit)
    lines = [
        f"# Gradients: {title}\n",
        f"{cfg.draws} draws, {wall_s:.0f} s. Made by `{command}`.\n",
        f"Elasticities d ln(mean SRMSE of {outputs}) / d ln(constant), with 95 % intervals over "
        f"draws. {of} = {1e3 * mean:.3f}; a draw has "
        f"{_range(findings.switches)} switches and {_range(findings.reallocations)} resets. "
        f"Verdicts are against **{judge}**: central differences, the judge.\n",
        "| constant | " + " | ".join(e.mode for e in findings.estimates) + " |",
        "|---" * (len(findings.estimates) + 1) + "|",
    ]
    for coordinate, label in enumerate(findings.labels):
        cells = []
        for estimate in findings.estimates:
            interval = estimate.intervals[coordinate]
            text = f"{interval.mean:+.3f} ± {interval.half:.3f}"
            if not estimate.mode.startswith("fd"):
                text += f"<br>{findings.verdict(estimate, coordinate)}"
            cells.append(text)
        lines.append(f"| {label} | " + " | ".join(cells) + " |")
    judged = findings.by(judge).intervals
    inside = [
        label
        for label, s, j in zip(
            findings.labels, findings.by("smoothed").intervals, judged, strict=True
        )
        if abs(s.mean - j.mean) <= j.half
    ]
    outside = [label for label in findings.labels if label not in inside]
    lines.append(
        f"\n`smoothed` (spread {100 * cfg.spread:g} %) lies inside the interval of {judge} for "
        f"{len(inside)} of {len(findings.labels)} constants"
        + (f"; outside: {', '.join(outside)}." if outside else ".")
    )
    silent = [
        label for label, i in zip(findings.labels, judged, strict=True) if not i.excludes_zero
    ]
    if silent:
        lines.append(f"\nNo signal by the judge: {', '.join(silent)} (its interval contains 0).")
    if findings.events:
        told = ", ".join(f"{name} {_range(n)}" for name, n in findings.events.items())
        lines.append(
            f"\nSteps of a hybrid rollout with an event, of {findings.n_steps}: {told}. Located "
            "events are differentiated through their time, sliding steps averaged, unresolved ones "
            "taken as plain does."
        )
    lines.append("\n| mode | norm of the gradient at horizon |\n|---|---|")
    for mode, series in findings.norms.items():
        text = ", ".join(f"{horizon:g} s: {norm:.3g}" for horizon, norm in series)
        lines.append(f"| {mode} | {text} |")
    return "\n".join(lines) + "\n"


def _range(counts: list[int]) -> str:
    low, high = min(counts), max(counts)
    return str(low) if low == high else f"{low} to {high}"


if __name__ == "__main__":
    main()
