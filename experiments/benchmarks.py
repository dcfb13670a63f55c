"""Problems with known answers: published or closed form beside ours, a verdict, a picture each."""

from __future__ import annotations

from .command import early

if __name__ == "__main__":
    early.begin("benchmarks")

import sys
import time
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

from hydra.core.hydra_config import HydraConfig
from omegaconf import OmegaConf

from mann_torch.errors import ConfigError

from .animations.every import check_animation, drawing_of
from .animations.files import animate
from .animations.motion import motion_of
from .building.build import Experiment
from .command.cli import command_line, reject_unknown, run_cli
from .command.failing import FAILED
from .problems import table
from .problems.every import PROBLEMS
from .problems.pictures import picture
from .problems.rolling import CaseResult, experiments_of, n_steps, run_case
from .records.recording import log_summary, summary_writer
from .runs.life import finish
from .runs.parts import all_parts, npz_parts
from .runs.pictures import check_pictures, linked, save_all
from .runs.writing import csv_text, write_arrays, write_text
from .settings.benchmarks_config import ENGINES, BenchmarksConfig
from .settings.checks import check_variants
from .settings.machine import check_workers

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Results = dict[tuple[str, str], CaseResult]


def main() -> None:
    """Command line of `python -m experiments.benchmarks`."""
    run_cli("benchmarks", checked, _task)


def checked(cfg: Any) -> tuple[BenchmarksConfig, dict[str, int]]:
    """The configuration as plain dataclasses, and steps by case; all is built once to check."""
    reject_unknown(cfg, BenchmarksConfig)
    plain = cast(BenchmarksConfig, OmegaConf.to_object(cfg))
    check_pictures(plain.output)
    check_workers(plain.workers)
    check_variants(plain.problems, tuple(PROBLEMS), "problem")
    if plain.engine not in ENGINES:
        raise ConfigError(f"engine = {plain.engine}: choose from {', '.join(ENGINES)}")
    steps = {
        f"{problem}-{case}": n_steps(plain, problem, case)
        for problem in plain.problems
        for case in PROBLEMS[problem].cases
    }
    if plain.output.animation:
        plants = [case[0].loop.plant for case in _cases(plain).values()]
        check_animation(plain.output, {type(plant).__name__: plant for plant in plants})
    return plain, steps


def _cases(cfg: BenchmarksConfig) -> dict[tuple[str, str], list[Experiment]]:
    """The loops of every case. Raises `ConfigError`."""
    return {
        (problem, name): experiments_of(cfg, case)
        for problem in cfg.problems
        for name, case in PROBLEMS[problem].cases.items()
    }


def _task(cfg: Any) -> None:
    plain, steps = checked(cfg)
    folder = Path(HydraConfig.get().runtime.output_dir)
    command = command_line("benchmarks")
    start = time.perf_counter()
    results = _all_results(plain, steps, folder / "finished")
    wall_s = time.perf_counter() - start
    rows = table.rows_of(results)
    figures = _draw(plain, results, folder) if plain.output.figures else {}
    films = _films(plain, results, folder) if plain.output.animation else {}
    for (problem, case), result in results.items():
        write_arrays(folder / "arrays" / f"{problem}-{case}.npz", result.arrays)
    engines = ", ".join(sorted({result.engine for result in results.values()}))
    lost = [
        f"- {problem}, {PROBLEMS[problem].cases[case].title}: {result.status}"
        for (problem, case), result in results.items()
        if result.status != "ok"
    ]
    sections = [
        f"# Problems with known answers\n\n{table.score(rows)}; {engines} engine, {wall_s:.0f} s "
        f"of {plain.workers} workers. Made by `{command}`.\n\nDeviation is relative, spread is how "
        "far ours moves at half the step, within is how far ours may be off: half of the last "
        "digit printed, 1e-6 of a closed form, 4 digits of what was published in single precision."
    ]
    for problem in plain.problems:
        shown = linked([f"figures/{problem}"] if figures else [], plain.output)
        shown += "".join(f"\n[{name}](figures/{name})\n" for name in films.get(problem, ()))
        own = [row for row in rows if row.problem == problem]
        sections.append(table.markdown(problem, own) + ("\n" + shown.rstrip() if shown else ""))
    if lost:
        sections.append("### Loops that were lost\n\n" + "\n".join(lost))
    report = "\n\n".join(sections) + "\n"
    write_text(folder / "report.md", report)
    write_text(folder / "table.csv", csv_text(table.csv_rows(rows)))
    if plain.output.tensorboard:
        scalars = {
            f"deviation/{row.problem}/{row.case}/{row.quantity}": row.deviation
            for row in rows
            if row.verdict != table.UNKNOWN
        }
        with summary_writer(folder, command) as writer:
            log_summary(writer, {"engine": plain.engine}, scalars, figures)
    finish(
        folder,
        {
            "command": command,
            "wall_s": wall_s,
            "engines": engines,
            "score": table.score(rows),
            "rows": [
                {**asdict(row), "deviation": row.deviation, "margin": row.margin} for row in rows
            ],
            "cases": {
                f"{problem}-{case}": {"dt": r.dt, "wall_s": r.wall_s, "status": r.status}
                for (problem, case), r in results.items()
            },
        },
    )
    print(report)
    print(f"written to {folder}: report.md, table.csv, metrics.json, figures/, arrays/", flush=True)
    off = sum(row.verdict == table.OFF for row in rows)
    if off:
        print(f"error: {off} numbers are off, see the report", file=sys.stderr)
        sys.exit(FAILED)


def _all_results(cfg: BenchmarksConfig, steps: dict[str, int], folder: Path) -> Results:
    """Every case's, in order; those on disk are not computed again."""
    names = {
        f"{problem}-{case}": (problem, case)
        for problem in cfg.problems
        for case in PROBLEMS[problem].cases
    }
    longest = sorted(names, key=lambda name: -steps[name])  # none of them is waited for at the end
    given = {name: (cfg, *names[name]) for name in longest}
    kept = npz_parts(CaseResult, folder)
    counts = [steps[name] for name in longest]
    found = all_parts(run_case, given, counts, kept, cfg.workers, "step")
    return {of: found[name] for name, of in names.items()}


def _films(cfg: BenchmarksConfig, results: Results, folder: Path) -> dict[str, list[str]]:
    """Names of the films of every problem whose plant has a drawing."""
    films: dict[str, list[str]] = {problem: [] for problem in cfg.problems}
    for (problem, name), (made, *_) in _cases(cfg).items():
        if drawing_of(made.loop.plant) is not None:
            motion = motion_of(made.loop.plant, made.scenario, results[problem, name].arrays)
            path = folder / "figures" / f"{problem}-{name}"
            title = f"{PROBLEMS[problem].title}: {PROBLEMS[problem].cases[name].title}"
            films[problem] += animate(path, cfg.output, motion, title)
    return films


def _draw(cfg: BenchmarksConfig, results: Results, folder: Path) -> dict[str, Figure]:
    drawn = {
        problem: picture(
            PROBLEMS[problem], {c: result for (p, c), result in results.items() if p == problem}
        )
        for problem in cfg.problems
    }
    save_all(folder / "figures", drawn, cfg.output)
    return drawn


if __name__ == "__main__":
    main()
