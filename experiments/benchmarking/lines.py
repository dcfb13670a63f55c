"""The compiled engine among its peers, every line in a process of its own."""

from __future__ import annotations

import dataclasses
import importlib.util
from collections.abc import Sequence
from typing import Any

import numpy as np
import torch
from tqdm import tqdm

import mann_torch as mt

from ..runs.writing import aligned
from .measure import MISSING, Section, in_process, reasons, verdict
from .row import PAPER, Line, experiment

LINES = (
    Line("compiled", 1, 330.0, 330.0, 20),
    Line("compiled", 64, 330.0, 330.0, 2),
    Line("compiled", 1024, 20.0, 10.0),
    Line("torch.compile", 1, 10.0, 2.0),
    Line("torch.compile", 64, 4.0, 0.4),
    Line("torch.compile", 1024, 1.0, 0.2),
    Line("eager", 1, 4.0, 1.0),
    Line("eager", 64, 2.0, 0.4),
    Line("eager", 1024, 0.6, 0.1),
    Line("dopri5", 1, 5.0, 0.2),
    Line("dopri5", 64, 1.0, 0.04),
    Line("dopri5", 1024, 0.5, 0.0),
    Line("rk4", 1, 2.0, 0.1),
    Line("rk4", 64, 0.5, 0.02),
    Line("rk4", 1024, 0.4, 0.0),
    Line("jax scan", 1, 330.0, 10.0, 3),
    Line("jax scan", 64, 33.0, 1.0, 2),
    Line("jax scan", 1024, 4.0, 0.2),
    Line("diffrax Tsit5", 1, 330.0, 0.0, 2),
    Line("compiled", 1, 330.0, 330.0, 20, PAPER),
    Line("compiled", 64, 330.0, 330.0, 2, PAPER),
    Line("compiled", 1024, 20.0, 10.0, 1, PAPER),
)
CUDA_LINES = tuple(Line("compiled cuda", b, 330.0, 33.0) for b in (1, 64, 1024, 65_536))
NAMES = {
    "compiled": "compiled, all cores",
    "compiled cuda": "compiled, CUDA",
    "torch.compile": "W-method, torch.compile",
    "eager": "W-method, eager torch",
    "dopri5": "torchdiffeq dopri5, rtol 1e-5",
    "rk4": "torchdiffeq rk4, 0.2 ms",
    "jax scan": "W-method, JAX lax.scan",
    "diffrax Tsit5": "diffrax Tsit5, rtol 1e-5",
}
HORIZON = 330.0
SAME = 0.5  # [%], by how much an engine's SRMSE may be off
ROOM = 1.0  # [GB] that the gradient of 64 rollouts of 330 s may take


def section(chosen: Sequence[str] = ()) -> Section:
    """All lines, or those of chosen engines."""
    lines = [*LINES, *(CUDA_LINES if torch.cuda.is_available() else ())]
    lines = [line for line in lines if not chosen or line.engine in chosen]
    results = [measured(line) for line in tqdm(lines, unit="line")]
    body = [["what it must show", "here", ""]]
    body += [[text, value, verdict(held)] for text, value, held in verdicts(results)]
    cuda = "" if torch.cuda.is_available() else " No CUDA device was at hand: its rows are missing."
    text = f"""N = 10, 5 slots, scenario 1, draws 0 to B - 1, float64. Soft attention is smooth, so
that every engine and solver must reach the same figure. Times are per simulated second and
trajectory; each line ran in a process of its own, on the stretch it names, and `~` marks 330 s
extrapolated from it. "With gradient" is forward and backward to all constants. "Off" compares SRMSE
of draw 0 with the limit over the same stretch, the W-method at 0.25 ms.{cuda}

{table(results)}{reasons(results)}

{aligned(body)}"""
    return Section(text, results)


def measured(line: Line) -> dict[str, Any]:
    """The line's numbers, or why there are none."""
    fields = dataclasses.asdict(line)
    peer = {"jax scan": "jax", "diffrax Tsit5": "diffrax"}.get(line.engine)
    if peer is not None and importlib.util.find_spec(peer) is None:
        return {**fields, "missing": f"{peer} is not installed (pip install mann_torch[bench])"}
    result = {**fields, **in_process("row", fields)}
    if "missing" not in result:
        result["off"] = _off(line, result["srmse"])
    return result


def _off(line: Line, srmse: list[float]) -> float:
    """Deviation [%] from the limit over the same stretch."""
    made = experiment(1, line.forward, line.loop)
    with torch.no_grad():
        fine = mt.rollout(
            made.loop,
            made.scenario,
            mt.Implicit(2.5e-4),
            weights=made.weights,
            motion_dt=1.0,
            sample_until=0.0,
            engine="compiled",
        )
    limit = mt.srmse(fine)[0].numpy()
    return float(100 * np.abs(np.array(srmse) / limit - 1).max())


def table(results: list[dict[str, Any]]) -> str:
    """All lines; each against the compiled engine on the same loop."""
    compiled = [r for r in results if r["engine"] == "compiled" and "missing" not in r]
    bases = {(r["loop"], r["batch"]): r["forward_s"] for r in compiled}
    head = ["engine", "loop", "B", "simulated", "ms per simulated s", "of compiled"]
    head += ["330 s, one trajectory"]
    head += ["with gradient", "over forward", "compile", "peak memory", "SRMSE x 10^3", "off"]
    body = [head]
    for r in results:
        loop = r["loop"].removesuffix("_initial")
        start = [NAMES[r["engine"]], loop, str(r["batch"]), f"{r['forward']:g} s"]
        if "missing" in r:
            body.append([*start, MISSING, *[""] * (len(head) - len(start) - 1)])
            continue
        base = bases.get((r["loop"], r["batch"]))
        ratio = r["forward_s"] / (base or 1.0)
        gradient = r.get("both_s")
        compile_s = r["compile_s"] + r.get("gradient_compile_s", 0.0)
        body.append(
            [
                *start,
                f"{1e3 * r['forward_s']:.3g}",
                "-" if base is None else f"{ratio:,.3g}" if ratio < 100 else f"{ratio:,.0f}",
                f"{'' if r['forward'] == HORIZON else '~ '}{HORIZON * r['forward_s']:,.3g} s",
                f"{1e3 * gradient:.3g}" if gradient else "-",
                f"{r['both_over_forward']:.1f}" if gradient else "-",
                f"{compile_s:.0f} s",
                f"{r['peak_mb']:,.0f} MB",
                " / ".join(f"{1e3 * value:.3f}" for value in r["srmse"]),
                f"{r['off']:.2f} %",
            ]
        )
    return aligned(body)


def verdicts(results: list[dict[str, Any]]) -> list[tuple[str, str, bool]]:
    """What the engine must show: (statement, figure, held); only where both sides were run."""
    by = {(r["engine"], r["loop"], r["batch"]): r for r in results if "missing" not in r}
    soft = [r for r in by.values() if r["loop"] != PAPER]
    found: list[tuple[str, str, bool]] = []
    for engine, least in (("dopri5", 1000), ("diffrax Tsit5", 100), ("jax scan", 1)):
        here, other = (by.get((name, "soft", 1)) for name in ("compiled", engine))
        if here is not None and other is not None:
            ratio = other["forward_s"] / here["forward_s"]
            text = f"at least {least} x {NAMES[engine]}, forward, B = 1"
            found.append((text, f"{ratio:,.0f} x", ratio >= least))
    for loop in ("soft", PAPER):
        many = by.get(("compiled", loop, 64))
        if many is not None:
            peak = many["peak_mb"] / 1024
            text = f"gradient of 64 rollouts of 330 s within {ROOM:g} GB of the process, {loop}"
            found.append((text, f"{peak:.2f} GB", peak <= ROOM))
    if soft:
        worst = max(r["off"] for r in soft)
        text = f"every engine's SRMSE within {SAME:g} % of the limit, soft"
        found.append((text, f"{worst:.2f} %", worst <= SAME))
    return found
