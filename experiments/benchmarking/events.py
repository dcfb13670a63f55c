"""What events cost: `python -m experiments.benchmarking.events JSON`, a case a process.

Hybrid against plain rollouts of one loop, in the scenarios in which slots chatter.
"""

from __future__ import annotations

import json
import sys
from dataclasses import asdict, dataclass
from functools import partial
from typing import Any

import torch

import mann_torch as mt
from mann_torch.compiled.host.kernels import lanes_here

from ..runs.writing import aligned
from .measure import (
    MISSING,
    Section,
    Side,
    Times,
    in_process,
    in_turns,
    ratio_of,
    reasons,
    steps_of,
)
from .row import CONSTANTS, error_of, experiment, slope_of

GRADIENTS = ("plain", "hybrid")


@dataclass(frozen=True)
class Case:
    """A scenario and a controller over a stretch of `horizon` [s]."""

    scenario: str
    batch: int
    loop: str
    horizon: float = 40.0
    rounds: int = 5


CASES = tuple(
    Case(scenario, batch, loop)
    for loop in ("hard", "reallocating_initial")
    for scenario in ("1", "5")
    for batch in (10, 64)
)


def compare(case: Case) -> dict[str, Any]:
    """Times [us] a step and trajectory, plain and hybrid, forward and with gradient, in turns."""
    made = experiment(case.batch, case.horizon, case.loop, case.scenario)
    short = experiment(case.batch, min(case.horizon, 0.02), case.loop, case.scenario)
    steps = steps_of(made)
    sides: dict[str, Side] = {}
    for gradient in GRADIENTS:
        error_of("compiled", short, gradient)  # compiles
        slope_of("compiled", short, CONSTANTS, gradient)
        sides[gradient] = (partial(error_of, "compiled", made, gradient), steps)
        both = partial(slope_of, "compiled", made, CONSTANTS, gradient)
        sides[f"{gradient} gradient"] = (both, steps)
    with torch.no_grad():
        met = mt.rollout(
            made.loop, made.scenario, made.solver, weights=made.weights, gradient="hybrid",
            motion_dt=1.0, sample_until=0.0,
        ).events  # fmt: skip
    times = in_turns(sides, case.rounds)
    counts = [1000.0 * float(count.sum()) / steps for count in met or ()]
    return {**asdict(case), "events": counts, "us": {k: list(t.each) for k, t in times.items()}}


def rows(results: list[dict[str, Any]]) -> list[list[str]]:
    """The table's lines under a head, two a case."""
    body = [["", "controller", "scenario", "B", "plain, us", "hybrid, us", "hybrid over plain"]]
    body[0].append("located, sliding, unresolved in 1000 steps")
    for result in results:
        size = [result["loop"], result["scenario"], str(result["batch"])]
        if "missing" in result:
            body.append(["", *size, MISSING, "", "", ""])
            continue
        us = {name: Times(tuple(each)) for name, each in result["us"].items()}
        met = ", ".join(f"{count:.1f}" for count in result["events"])
        for more in ("", " gradient"):
            plain, hybrid = (us[f"{gradient}{more}"] for gradient in GRADIENTS)
            what = "forward + backward" if more else "forward"
            shown = ratio_of(hybrid, plain)[1]
            body.append([what, *size, str(plain), str(hybrid), shown, "" if more else met])
    return body


def section() -> Section:
    """Every case in a process of its own."""
    results = [{**asdict(c), **in_process("events", asdict(c))} for c in CASES]
    case = CASES[0]
    text = f"""`gradient="hybrid"` against `gradient="plain"` on the compiled engine, N = 10,
5 slots, {case.horizon:g} s, gradient to {len(CONSTANTS)} constants. us a step and trajectory,
median (and least) of {case.rounds} rounds in turns, all cores, {lanes_here()} lanes.

{aligned(rows(results))}{reasons(results)}"""
    return Section(text, results)


if __name__ == "__main__":
    print(json.dumps(compare(Case(**json.loads(sys.argv[1])))))
