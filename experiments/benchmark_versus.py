"""The compiled engine against the hand-written kernel: `python -m experiments.benchmark_versus`.

On one loop that both run, the paper's: reallocation, N = 10, 5 slots, scenario 1.
"""

from __future__ import annotations

import json
import sys
from dataclasses import asdict, dataclass
from functools import partial
from typing import Any

from mann_torch.compiled.host.kernels import lanes_here

from .benchmark_measure import (
    MISSING,
    Section,
    Side,
    Times,
    in_process,
    in_turns,
    ratio_of,
    reasons,
    steps_of,
    threads,
    verdict,
)
from .benchmark_row import PAPER, error_of, experiment, slope_of
from .tables import aligned

#: The constants that every gradient here goes to.
CONSTANTS = (
    *("error_gain", "base_gain", "robust_gain"),
    *("rate_W", "rate_V", "e_modification", "write_gain"),
)
ENGINES = ("hand-written", "compiled")
ROUNDS = 7
#: Forward + backward costs at most so many times the forward pass.
OVER_FORWARD = 4.5


@dataclass(frozen=True)
class Case:
    """One size, on so many threads, over a stretch of `horizon` [s]."""

    batch: int
    threads: int
    horizon: float
    rounds: int = ROUNDS


CASES = (
    Case(1, 1, 330.0),
    Case(64, 1, 40.0),
    Case(64, 2, 40.0),
    Case(1024, 1, 4.0),
    Case(1024, 2, 4.0),
)


def least_ratio(batch: int, count: int, gradient: bool, lanes: int) -> float:
    """How many times as fast as the hand-written kernel the compiled one has to be."""
    if batch == 1:
        return 1.4 if gradient else 1.3
    if count > 1:
        return 4.0 if gradient else 3.5
    return 5.0 if gradient else 4.0 if lanes >= 8 else 3.0


def compare(case: Case) -> dict[str, Any]:
    """Times [us] a step and trajectory of both engines, forward and with gradient, in turns."""
    made = experiment(case.batch, case.horizon, PAPER)
    short = experiment(case.batch, min(case.horizon, 0.02), PAPER)
    steps = steps_of(made)
    with threads(case.threads):
        for engine in ENGINES:  # compiles
            error_of(engine, short)
            slope_of(engine, short, CONSTANTS)
        found = [error_of(engine, made) for engine in ENGINES]
        sides: dict[str, Side] = {}
        for engine in ENGINES:
            sides[engine] = (partial(error_of, engine, made), steps)
            sides[f"{engine} gradient"] = (partial(slope_of, engine, made, CONSTANTS), steps)
        times = in_turns(sides, case.rounds)
    apart = float((found[1] / found[0] - 1.0).abs().max())
    return {**asdict(case), "apart": apart, "us": {k: list(t.each) for k, t in times.items()}}


def rows(results: list[dict[str, Any]], lanes: int) -> list[list[str]]:
    """The table's lines under a head, two a case."""
    body = [["", "B", "threads", "simulated", "hand-written, us", "compiled, us"]]
    body[0] += ["ratio", "at least", "", "over forward", "at most", ""]
    for result in results:
        size = [str(result["batch"]), str(result["threads"]), f"{result['horizon']:g} s"]
        if "missing" in result:
            body.append(["", *size, MISSING, *[""] * 7])
            continue
        us = {name: Times(tuple(each)) for name, each in result["us"].items()}
        for gradient in (False, True):
            hand, mine = (us[f"{e} gradient" if gradient else e] for e in ENGINES)
            least = least_ratio(result["batch"], result["threads"], gradient, lanes)
            ratio, shown = ratio_of(hand, mine)
            line = ["forward + backward" if gradient else "forward", *size, str(hand), str(mine)]
            line += [shown, f"{least:g}", verdict(ratio >= least)]
            if gradient:
                over, shown = ratio_of(mine, us["compiled"])
                line += [shown, f"{OVER_FORWARD:g}", verdict(over <= OVER_FORWARD)]
            body.append([*line, *[""] * (len(body[0]) - len(line))])
    return body


def section() -> Section:
    """Every case in a process of its own."""
    results = [{**asdict(c), **in_process("benchmark_versus", asdict(c))} for c in CASES]
    lanes = lanes_here()
    apart = max((r["apart"] for r in results if "apart" in r), default=float("nan"))
    text = f"""The paper's controller (reallocation, N = 10, 5 slots) in scenario 1, gradient to
{len(CONSTANTS)} constants. us a step and trajectory, median (and least) of {ROUNDS} rounds; in a
round the engines take turns, every other round backwards. {lanes} lanes of float64.

{aligned(rows(results, lanes))}{reasons(results)}

SRMSE of the two differs by at most {apart:.1e} of itself."""
    return Section(text, results)


if __name__ == "__main__":
    print(json.dumps(compare(Case(**json.loads(sys.argv[1])))))
