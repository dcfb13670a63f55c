"""Parts of one's own, compiled and on the torch engine: see `experiments.benchmark`.

The arm of n links, and the attention of docs/write/attention.md.
"""

from __future__ import annotations

import json
import re
import sys
from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from functools import partial
from typing import Any

import torch

import mann_torch as mt
from mann_torch.plants import NLinkArm
from mann_torch.types import MemoryState

from ..building.build import Experiment
from ..runs.writing import aligned
from .measure import (
    MISSING,
    ROOT,
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
from .row import error_of, run, slope_of, smooth_constants

ENGINES = ("eager", "compiled")
ROUNDS = 5
#: How many times as fast as the torch engine, by batch size; how far q may be off [rad].
LEAST, SAME = {1: 400.0, 64: 50.0}, 1e-12


@dataclass(frozen=True)
class Case:
    """A part at one batch size; seconds simulated on the torch engine, and compiled."""

    part: str
    batch: int
    torch: float = 0.4
    compiled: float = 330.0
    rounds: int = ROUNDS


def n_link(n: int, batch: int, horizon: float) -> Experiment:
    """The paper's controller on an arm of n links, together 2 m long and of 3.1 kg."""
    ones = torch.ones(n, dtype=torch.float64)
    memory = mt.WorkingMemory(5, 10, mt.ReallocatingAttention("initial"))
    arm = NLinkArm(n)
    parameters = arm.parameters_of(masses=3.1 / n * ones, lengths=2.0 / n * ones)
    return _made(arm, memory, parameters, batch, horizon)


def k_nearest(batch: int, horizon: float) -> Experiment:
    """The paper's arm under the attention that docs/write/attention.md prints."""
    page = (ROOT / "docs" / "write" / "attention.md").read_text()
    snippets = re.findall(r"```python\n(.*?)```", page, re.S)
    (snippet,) = (text for text in snippets if "class KNearestAttention" in text)
    names: dict[str, Any] = {}
    exec(compile(snippet, "docs/write/attention.md", "exec"), names)
    memory = mt.WorkingMemory(5, 10, names["KNearestAttention"](k=2))
    # Slots that start alike stay alike: nothing would depend on the temperature.
    spread = torch.randn(5, 10, generator=torch.Generator().manual_seed(1), dtype=torch.float64)
    memory.store_(MemoryState(0.4 + 0.1 * spread, memory.initial_keys))
    return _made(mt.TwoLinkArm(), memory, mt.arm_parameters(), batch, horizon)


def _made(
    plant: mt.Plant, memory: mt.WorkingMemory, parameters: Any, batch: int, horizon: float
) -> Experiment:
    n = len(plant.outputs)
    controller = mt.MannController(n, 10, memory)
    reference = mt.Sinusoid([1.0, *[0.5] * (n - 1)], 0.5)
    scenario = mt.Scenario(reference, parameters, horizon)
    weights = controller.initial_weights((batch,), torch.Generator().manual_seed(0))
    return Experiment(mt.ClosedLoop(plant, controller), scenario, mt.Implicit(), weights)


PARTS: dict[str, Callable[[int, float], Experiment]] = {
    "arm of 2 links": partial(n_link, 2),
    "arm of 3 links": partial(n_link, 3),
    "arm of 5 links": partial(n_link, 5),
    "KNearestAttention": k_nearest,
}
CASES = tuple(
    Case(part, batch, compiled=horizon)
    for part in PARTS
    for batch, horizon in ((1, 330.0), (64, 20.0))
)


def compare(case: Case) -> dict[str, Any]:
    """Times [us] a step and trajectory of both engines in turns, and how far they are apart."""
    sides: dict[str, Side] = {}
    q, slopes = [], []
    with threads(1):
        for engine, horizon in zip(ENGINES, (case.torch, case.compiled), strict=True):
            made = PARTS[case.part](case.batch, horizon)
            scenario = replace(made.scenario, horizon=case.torch)
            short = replace(made, scenario=scenario)  # the same loop: compiled for both
            names = smooth_constants(made)
            with torch.no_grad():
                q.append(run(engine, short, motion_dt=None).output)
            slopes.append(slope_of(engine, short, names)[1])
            if not bool(error_of(engine, made).isfinite().all()):
                raise ArithmeticError(f"{case.part}: a trajectory diverged")
            sides[engine] = (partial(error_of, engine, made), steps_of(made))
            sides[f"{engine} gradient"] = (partial(slope_of, engine, made, names), steps_of(made))
        times = in_turns(sides, case.rounds)
    off = [float((a - b).abs().max() / a.abs().max()) for a, b in zip(*slopes, strict=True)]
    return {
        **asdict(case),
        "apart": float((q[0] - q[1]).abs().max()),
        "gradient_apart": max(off),
        "us": {k: list(t.each) for k, t in times.items()},
    }


def rows(results: list[dict[str, Any]]) -> list[list[str]]:
    """The table's lines under a head, two a case."""
    body = [["part", "", "B", "torch, us", "compiled, us", "ratio", "at least", ""]]
    body[0] += [f"apart after {Case.torch:g} s", "at most", ""]
    for result in results:
        start = [result["part"], "", str(result["batch"])]
        if "missing" in result:
            body.append([*start, MISSING, *[""] * 7])
            continue
        us = {name: Times(tuple(each)) for name, each in result["us"].items()}
        for gradient in (False, True):
            slow, fast = (us[f"{e} gradient" if gradient else e] for e in ENGINES)
            least = LEAST[result["batch"]]
            ratio, shown = ratio_of(slow, fast)
            start[1] = "forward + backward" if gradient else "forward"
            line = [*start, str(slow), str(fast), shown, f"{least:g}", verdict(ratio >= least)]
            if gradient:
                line += [f"{result['gradient_apart']:.1e} of a gradient", "", ""]
            else:
                apart = result["apart"]
                line += [f"{apart:.1e} rad", f"{SAME:g} rad", verdict(apart <= SAME)]
            body.append(line)
    return body


def section() -> Section:
    """Every part in a process of its own."""
    results = [{**asdict(c), **in_process("parts", asdict(c))} for c in CASES]
    seconds = {c.batch: f"{c.compiled:g} s" for c in CASES}
    text = f"""Written for neither engine: a planar arm of n links (`NLinkArm`) under the paper's
controller, and the attention that docs/write/attention.md prints, on the paper's arm. Gradient to
all constants that have one. us a step and trajectory on one thread, median (and least) of {ROUNDS}
rounds in turns; {Case.torch:g} s are simulated on the torch engine, compiled
{" and ".join(seconds.values())} (B = 1 and 64).

{aligned(rows(results))}{reasons(results)}"""
    return Section(text, results)


if __name__ == "__main__":
    print(json.dumps(compare(Case(**json.loads(sys.argv[1])))))
