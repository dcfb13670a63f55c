"""How long the first rollout takes: `python -m experiments.benchmarking.start JSON`, each in
its own process, with nothing on disk and with what the process before left there.
"""

from __future__ import annotations

import json
import statistics
import sys
import tempfile
import time
from typing import Any

from ..runs.writing import aligned
from .measure import MISSING, Section, in_process, reasons, verdict
from .row import CONSTANTS, PAPER, error_of, experiment, slope_of

BATCHES, ROUNDS = (1, 64), 3
#: Seconds that a start may take: forward and with gradient from nothing, either from disk.
COLD, WARM = {False: 3.0, True: 6.0}, 1.5


def first(batch: int, gradient: bool) -> dict[str, float]:
    """Seconds of this process's first rollout, of five steps, and of the second."""
    made, found = experiment(batch, 0.02, PAPER), []
    for _ in range(2):
        start = time.perf_counter()
        if gradient:
            slope_of("compiled", made, CONSTANTS)
        else:
            error_of("compiled", made)
        found.append(time.perf_counter() - start)
    return {"first": found[0], "second": found[1]}


def measure(batch: int, gradient: bool, rounds: int) -> dict[str, Any]:
    """Seconds of the first rollout, from nothing and from disk, round by round."""
    result: dict[str, Any] = {"batch": batch, "gradient": gradient, "cold": [], "warm": []}
    for _ in range(rounds):
        with tempfile.TemporaryDirectory() as folder:
            for name in ("cold", "warm"):
                found = in_process("start", [batch, gradient], WARP_CACHE_PATH=folder)
                if "missing" in found:
                    return {**result, **found}
                result[name].append(found["first"])
    return result


def rows(results: list[dict[str, Any]]) -> list[list[str]]:
    """The table's lines under a head."""
    body = [["first rollout", "B", "from nothing", "at most", "", "from disk", "at most", ""]]
    for result in results:
        what = "forward + backward" if result["gradient"] else "forward"
        line = [what, str(result["batch"])]
        if "missing" in result:
            body.append([*line, MISSING, *[""] * 5])
            continue
        for name, most in (("cold", COLD[result["gradient"]]), ("warm", WARM)):
            seconds = statistics.median(result[name])
            shown = f"{seconds:.2f} s ({min(result[name]):.2f} s)"
            line += [shown, f"{most:g} s", verdict(seconds <= most)]
        body.append(line)
    return body


def section() -> Section:
    """Forward and with gradient, one trajectory and a batch in lanes."""
    results = [measure(b, gradient, ROUNDS) for gradient in (False, True) for b in BATCHES]
    text = f"""Trace, compile, load and five steps of the paper's controller in a new process,
imports apart; median (and least) of {ROUNDS}. "From nothing": an empty folder of kernels; "from
disk": the next process with that folder.

{aligned(rows(results))}{reasons(results)}"""
    return Section(text, results)


if __name__ == "__main__":
    print(json.dumps(first(*json.loads(sys.argv[1]))))
