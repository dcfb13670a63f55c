"""Reproduce the paper: every table beside ours, every figure, every claim."""

from __future__ import annotations

from .command import early

if __name__ == "__main__":
    early.begin("reproduce")

import sys
import time
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

import numpy as np
from hydra.core.hydra_config import HydraConfig
from omegaconf import OmegaConf

from mann_torch.errors import ConfigError

from .command.cli import command_line, reject_unknown, run_cli
from .command.failing import FAILED
from .records.recording import log_summary, summary_writer
from .reproduction import golden as gold
from .reproduction import pictures, tables
from .reproduction.claims import Finding, findings
from .reproduction.jobs import JobResult, batches, check_recorded, n_steps, run_job
from .reproduction.plan import Job, judges_claims, plan
from .reproduction.results import Results
from .reproduction.tables import Cell
from .runs.figures import of_draws
from .runs.life import finish
from .runs.parts import all_parts
from .runs.pictures import check_pictures, linked, save_all
from .runs.writing import aligned, csv_text, write_arrays, write_text
from .settings.checks import check_horizon
from .settings.config import ReproduceConfig
from .settings.machine import check_workers

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def main() -> None:
    """Command line of `python -m experiments.reproduce`."""
    run_cli("reproduce", checked, _task)


def checked(cfg: Any) -> tuple[ReproduceConfig, list[Job], gold.GoldenFile | None]:
    """The configuration as plain dataclasses, and its jobs; everything is built once to check."""
    reject_unknown(cfg, ReproduceConfig)
    plain = cast(ReproduceConfig, OmegaConf.to_object(cfg))
    check_pictures(plain.output)
    check_workers(plain.workers)
    check_horizon(plain.horizon)
    golden = gold.golden_file(plain)
    jobs = plan(plain, list(golden.runs) if golden is not None else [])
    if not jobs:
        raise ConfigError("nothing to do: no tables, figures or claims are chosen")
    for job in jobs:
        check_recorded(plain, job)
        batches(plain, job)
    return plain, jobs, golden


def _task(cfg: Any) -> None:
    plain, jobs, golden = checked(cfg)
    folder = Path(HydraConfig.get().runtime.output_dir)
    command = command_line("reproduce")
    start = time.perf_counter()
    done = _all_results(plain, jobs, folder / "runs")
    results = Results(done)
    wall_s = time.perf_counter() - start

    all_cells = [c for table in plain.tables.values() for c in tables.cells(table, results)]
    found = findings(results) if judges_claims(plain) else []
    checks = gold.checks(golden, results, plain) if golden is not None else []
    diverged = [
        f"{result.job.variant}, scenario {scenario}, draw {draw}: {status}"
        for result in done
        for scenario, statuses in zip(result.job.scenarios, result.status, strict=True)
        for draw, status in enumerate(statuses)
        if status != "ok"
    ]
    drawn = _draw(plain, results, all_cells, folder) if plain.output.figures else {}
    engines = ", ".join(sorted({result.engine for result in done}))
    sections = [
        f"# The paper, reproduced\n\n{plain.draws} draws, {plain.solver.name} at "
        f"{1e3 * plain.solver.dt:g} ms ({engines}), {wall_s:.0f} s. Made by `{command}`.",
        *[tables.markdown(table, results) for table in plain.tables.values()],
    ]
    if all_cells:
        sections.append(_summary(all_cells))
    if found:
        sections.append(_claims(found))
    if golden is not None:
        sections.append(gold.markdown(checks, golden.path))
    if diverged:
        sections.append("### Diverged\n\n" + "\n".join(f"- {line}" for line in diverged))
    report = "\n\n".join(sections) + "\n"
    shown = linked((f"figures/{name}" for name in drawn), plain.output)
    write_text(folder / "report.md", report + shown)
    write_text(folder / "tables.csv", csv_text(tables.cell_rows(all_cells)))
    write_text(folder / "reductions.csv", csv_text(tables.reduction_rows(plain.tables, results)))
    claim_rows = [["claim", "reproduced", "measure"]]
    claim_rows += [[f.claim, "yes" if f.reproduced else "no", f.measure] for f in found]
    write_text(folder / "claims.csv", csv_text(claim_rows))
    settings = {"draws": plain.draws, "seed": plain.seed, "solver": plain.solver.name}
    settings |= {"dt": plain.solver.dt}
    scalars = {
        f"{c.metric}/scenario_{c.scenario}/{c.variant}/joint_{c.joint}": c.mean for c in all_cells
    }
    if plain.output.tensorboard:
        with summary_writer(folder, command) as writer:
            log_summary(writer, settings, scalars, drawn)
    finish(
        folder,
        {
            "command": command,
            "wall_s": wall_s,
            "engines": engines,
            "score": tables.score(all_cells),
            "cells": [{**asdict(c), "verdict": c.verdict} for c in all_cells],
            "claims": [asdict(finding) for finding in found],
            "golden": [{**asdict(check), "passed": check.passed} for check in checks],
            "diverged": diverged,
        },
    )
    print(report)
    print(f"written to {folder}: report.md, *.csv, metrics.json, figures/, runs/", flush=True)
    if any(not check.passed for check in checks):
        print("error: golden numbers are off, see the report", file=sys.stderr)
        sys.exit(FAILED)


def _all_results(cfg: ReproduceConfig, jobs: list[Job], folder: Path) -> list[JobResult]:
    """Every variant's, in order; those on disk are not computed again."""
    of = {job.variant: job for job in jobs}

    def read(variant: str) -> JobResult | None:
        return JobResult.kept(of[variant], folder / f"{variant}.npz")

    def write(variant: str, result: JobResult) -> None:
        write_arrays(folder / f"{variant}.npz", result.arrays())

    given = {variant: (cfg, job) for variant, job in of.items()}
    counts = [n_steps(cfg, job) for job in jobs]
    return list(all_parts(run_job, given, counts, (read, write), cfg.workers, "step").values())


def _summary(all_cells: list[Cell]) -> str:
    lines = ["### Summary", "", tables.score(all_cells) + "."]
    ratios = tables.slots_table(all_cells)
    if len(ratios):
        change = 100 * (ratios - 1)
        lines += [
            "",
            "A memory of one slot against the paper's controller with five: SRMSE "
            f"{change.mean():+.1f} % on average over tables and joints "
            f"({change.min():+.1f} to {change.max():+.1f} %).",
        ]
    return "\n".join(lines)


def _claims(found: list[Finding]) -> str:
    body = [["claim", "here", "measure"]]
    for finding in found:
        verdict = "reproduced" if finding.reproduced else "not reproduced"
        body.append([finding.claim, verdict, finding.measure])
    held = sum(finding.reproduced for finding in found)
    head = f"### Claims: {held} of {len(found)} reproduced\n\nChanges: mean over draws ± half of "
    return head + "the paired 95 % interval, in %, joint 1 / joint 2.\n\n" + aligned(body)


def _draw(
    cfg: ReproduceConfig, results: Results, all_cells: list[Cell], folder: Path
) -> dict[str, Figure]:
    drawn: dict[str, Figure] = {}
    for name, figure in cfg.figures.items():
        runs = {
            variant: of_draws(results.signals(figure.scenario, variant), 0)
            for variant in figure.variants
        }
        for panel in figure.panels:
            drawn[f"{name}_{panel}"] = pictures.panel(panel, runs, figure.title)
    rows = [
        (f"{c.table.split(':')[0]}, {c.label}, joint {c.joint}", c.paper, c.mean, c.sd)
        for c in tables.published(all_cells)
        if c.paper is not None
    ]
    if rows:
        drawn["against_paper"] = pictures.against_paper(
            [(label, paper, mean, 0.0 if np.isnan(sd) else sd) for label, paper, mean, sd in rows],
            "SRMSE against the published figures",
        )
    save_all(folder / "figures", drawn, cfg.output)
    return drawn


if __name__ == "__main__":
    main()
