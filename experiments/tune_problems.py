"""Benchmark problems tuned by gradient through the loop, beside published constants."""

from __future__ import annotations

from .command import early

if __name__ == "__main__":
    early.begin("tune_problems")

import time
from pathlib import Path
from typing import Any, cast

from hydra.core.hydra_config import HydraConfig
from omegaconf import OmegaConf

from mann_torch.checks import NONNEGATIVE, number
from mann_torch.errors import ConfigError

from .command.cli import command_line, reject_unknown, run_cli
from .learning.report import conclude
from .problem_tuning.judging import PROBLEMS, Found, judged_way, steps_of
from .problem_tuning.report import pictures, reported
from .problem_tuning.tuned_problem import TunedProblem
from .runs.parts import all_parts, npz_parts
from .runs.pictures import check_pictures
from .settings.checks import check_between, check_positive, check_variants
from .settings.machine import check_memory, check_workers
from .settings.problem_tuning_config import ProblemTuningConfig

#: Bytes that a held-out member keeps for its judges, at most.
_MEMBER = 2_000_000


def main() -> None:
    """Command line of `python -m experiments.tune_problems`."""
    run_cli("tune_problems", checked, _task)


def checked(cfg: Any) -> ProblemTuningConfig:
    """A composed configuration as a plain dataclass, verified. Raises `ConfigError`."""
    reject_unknown(cfg, ProblemTuningConfig)
    plain = cast(ProblemTuningConfig, OmegaConf.to_object(cfg))
    check_pictures(plain.output)
    check_variants(plain.problems, tuple(PROBLEMS), "problem")
    check_between(plain, {"train": (1, 1000), "held_out": (2, 10_000)})
    check_between(plain, {"iterations": (1, 10_000), "seed": (0, 2**31)})
    for name in ("train_horizon", "rate", "effort_limit"):
        check_positive(name, getattr(plain, name))
    if len(plain.noise) != 2:
        raise ConfigError(f"noise = {plain.noise}: give two numbers, of positions and rates")
    for value in plain.noise:
        number("noise", value, NONNEGATIVE)
    check_workers(plain.workers)
    check_memory("train and held_out", _MEMBER * plain.workers * (8 * plain.train + plain.held_out))
    return plain


def _task(cfg: Any) -> None:
    plain = checked(cfg)
    folder = Path(HydraConfig.get().runtime.output_dir)
    start = time.perf_counter()
    tasks: dict[str, TunedProblem] = {name: PROBLEMS[name](plain) for name in plain.problems}
    jobs = {(p, way): task.ways[way] for p, task in tasks.items() for way in task.ways}
    parts = all_parts(
        judged_way,
        {f"{problem}_{way}": (plain, problem, way) for problem, way in jobs},
        [steps_of(plain, way) for way in jobs.values()],
        npz_parts(Found, folder / "finished"),
        plain.workers,
        "step",
        1,
    )
    found = dict(zip(jobs, parts.values(), strict=True))
    report = reported(plain, tasks, found, time.perf_counter() - start)
    command = command_line("tune_problems")
    conclude(folder, plain, command, report, lambda: pictures(tasks, found))


if __name__ == "__main__":
    main()
