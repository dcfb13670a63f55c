"""What every part of the benchmark measures with: turns, threads, processes, sections."""

from __future__ import annotations

import json
import math
import os
import statistics
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import torch
from matplotlib.figure import Figure

from ..building.build import Experiment

ROOT = Path(__file__).parents[2]
MICRO = 1e6
MISSING = "not measured"
#: What to run, and how many steps that is for all trajectories together.
Side = tuple[Callable[[], object], int]


@dataclass(frozen=True)
class Section:
    """One section of the page: its text, the numbers behind it, its figures by file name."""

    text: str
    numbers: Any
    figures: Mapping[str, Figure] = field(default_factory=dict)


@dataclass(frozen=True)
class Times:
    """A side's times [us] a step and trajectory, one a round."""

    each: tuple[float, ...]

    @property
    def median(self) -> float:
        """What the verdicts use."""
        return statistics.median(self.each)

    @property
    def least(self) -> float:
        """What the machine can do when nothing else is on it."""
        return min(self.each)

    def __str__(self) -> str:
        return f"{self.median:.3g} ({self.least:.3g})"


def in_turns(sides: Mapping[str, Side], rounds: int) -> dict[str, Times]:
    """Every side once a round, every other round backwards: a busy machine weighs on all alike."""
    found: dict[str, list[float]] = {name: [] for name in sides}
    for number in range(rounds):
        order = list(sides) if number % 2 == 0 else list(sides)[::-1]
        for name in order:
            run, steps = sides[name]
            start = time.perf_counter()
            run()
            found[name].append(MICRO * (time.perf_counter() - start) / steps)
    return {name: Times(tuple(each)) for name, each in found.items()}


def steps_of(made: Experiment) -> int:
    """Steps of all trajectories of an experiment together."""
    return math.ceil(made.scenario.end / made.solver.dt) * len(made.weights.W)


def ratio_of(slow: Times, fast: Times) -> tuple[float, str]:
    """How many times as fast, and the same as text: of the medians (and of the least)."""
    ratio, least = slow.median / fast.median, slow.least / fast.least
    digits = ".2f" if ratio < 10 else ",.0f"
    return ratio, f"{ratio:{digits}} ({least:{digits}})"


def verdict(held: bool) -> str:
    """How the page says whether a target is met."""
    return "ok" if held else "NOT MET"


def reasons(results: Sequence[Mapping[str, Any]]) -> str:
    """Why lines were not measured: a paragraph a reason, empty where all were."""
    lines: dict[str, list[str]] = {}
    for result in results:
        if "missing" in result:
            name = result.get("engine", result.get("part", ""))
            label = f"{name}, B = {result['batch']}" if name else f"B = {result['batch']}"
            lines.setdefault(result["missing"], []).append(label)
    return "".join(f"\n\n{MISSING}, {'; '.join(at)}: {why}" for why, at in lines.items())


@contextmanager
def threads(count: int) -> Iterator[None]:
    """Torch, and with it both engines, on so many threads."""
    before = torch.get_num_threads()
    torch.set_num_threads(count)
    try:
        yield
    finally:
        torch.set_num_threads(before)


def in_process(module: str, given: object, **environment: str) -> dict[str, Any]:
    """What `python -m experiments.benchmarking.MODULE JSON` prints as JSON in its last line.

    Or `missing`: why there is nothing.
    """
    command = [sys.executable, "-m", f"experiments.benchmarking.{module}", json.dumps(given)]
    done = subprocess.run(
        command, capture_output=True, text=True, cwd=ROOT, env={**os.environ, **environment}
    )
    if done.returncode != 0:
        last = done.stderr.strip().splitlines()
        return {"missing": last[-1] if last else f"exit code {done.returncode}"}
    result: dict[str, Any] = json.loads(done.stdout.strip().splitlines()[-1])
    return result
