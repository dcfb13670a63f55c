"""Every engine on the same loop, in one run: `make bench` writes BENCHMARKS.md."""

from __future__ import annotations

import argparse
import dataclasses
import importlib.metadata
import importlib.util
import json
import os
import platform
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
import torch
from tqdm import tqdm

import mann_torch as mt

from .benchmark_curves import Curves, curves
from .benchmark_row import Line, experiment
from .figures import save
from .tables import aligned
from .writing import write_json, write_text

ROOT = Path(__file__).parent.parent
LINES = (
    Line("fused", 1, 330.0, 330.0, 20),
    Line("fused", 64, 330.0, 330.0, 2),
    Line("fused", 1024, 20.0, 10.0),
    Line("compiled", 1, 10.0, 2.0),
    Line("compiled", 64, 4.0, 0.4),
    Line("compiled", 1024, 1.0, 0.2),
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
)
CUDA_LINES = tuple(Line("fused cuda", b, 330.0, 33.0) for b in (1, 64, 1024, 65_536))
NAMES = {
    "fused": "fused (Warp, all cores)",
    "fused cuda": "fused (Warp, CUDA)",
    "compiled": "W-method, torch.compile",
    "eager": "W-method, eager torch",
    "dopri5": "torchdiffeq dopri5, rtol 1e-5",
    "rk4": "torchdiffeq rk4, 0.2 ms",
    "jax scan": "W-method, JAX lax.scan",
    "diffrax Tsit5": "diffrax Tsit5, rtol 1e-5",
}
HORIZON = 330.0
SAME = 0.5  # [%], by how much an engine's SRMSE may be off


def main() -> None:
    """Command line of `python -m experiments.benchmark`."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, default=ROOT / "BENCHMARKS.md", help="the page")
    parser.add_argument("--only", default="", help="engines, comma-separated; all if not given")
    options = parser.parse_args()
    chosen = [name for name in options.only.split(",") if name]
    unknown = set(chosen) - set(NAMES)
    if unknown:
        parser.error(f"unknown engine {sorted(unknown)}; choose from {', '.join(NAMES)}")
    lines = [*LINES, *(CUDA_LINES if torch.cuda.is_available() else ())]
    lines = [line for line in lines if not chosen or line.engine in chosen]
    results = [_measured(line) for line in tqdm(lines, unit="line")]
    found = curves()
    pictures = options.out.parent / "docs"
    for name, figure in found.figures.items():
        save(figure, pictures / f"{name}.png")
    page = _page(results, found)
    write_text(options.out, page)
    folder = ROOT / "logs" / "benchmark" / time.strftime("%Y-%m-%d_%H-%M-%S")
    write_json(folder / "results.json", {"lines": results, "curves": found.numbers})
    print(page)
    print(f"written to {options.out}, {pictures} and {folder}")


def _measured(line: Line) -> dict[str, Any]:
    """The line's numbers, or why there are none; each in a process of its own."""
    fields = dataclasses.asdict(line)
    peer = {"jax scan": "jax", "diffrax Tsit5": "diffrax"}.get(line.engine)
    if peer is not None and importlib.util.find_spec(peer) is None:
        return {**fields, "missing": f"{peer} is not installed (pip install mann_torch[bench])"}
    command = [sys.executable, "-m", "experiments.benchmark_row", json.dumps(fields)]
    done = subprocess.run(command, capture_output=True, text=True, cwd=ROOT)
    if done.returncode != 0:
        last = done.stderr.strip().splitlines()
        return {**fields, "missing": last[-1] if last else f"exit code {done.returncode}"}
    result: dict[str, Any] = json.loads(done.stdout.strip().splitlines()[-1])
    result["off"] = _off(line, result["srmse"])
    return result


def _off(line: Line, srmse: list[float]) -> float:
    """Deviation [%] from the limit over the same stretch: the W-method at 0.25 ms."""
    made = experiment(1, line.forward)
    with torch.no_grad():
        fine = mt.rollout(
            made.loop,
            made.scenario,
            mt.Implicit(2.5e-4),
            network=made.network,
            motion_dt=1.0,
            sample_until=0.0,
        )
    limit = mt.srmse(fine)[0].numpy()
    return float(100 * np.abs(np.array(srmse) / limit - 1).max())


def _table(results: list[dict[str, Any]]) -> str:
    base = {r["batch"]: r["forward_s"] for r in results if r["engine"] == "fused"}
    head = ["engine", "B", "simulated", "ms per simulated s", "of fused", "330 s, one trajectory"]
    head += ["with gradient", "over forward", "compile", "peak memory", "SRMSE x 10^3", "off"]
    body = [head]
    for r in results:
        start = [NAMES[r["engine"]], str(r["batch"]), f"{r['forward']:g} s"]
        if "missing" in r:
            body.append([*start, r["missing"], *[""] * (len(head) - len(start) - 1)])
            continue
        ratio = r["forward_s"] / base[r["batch"]] if r["batch"] in base else float("nan")
        gradient = r.get("both_s")
        compile_s = r["compile_s"] + r.get("gradient_compile_s", 0.0)
        body.append(
            [
                *start,
                f"{1e3 * r['forward_s']:.3g}",
                f"{ratio:,.3g}" if ratio < 100 else f"{ratio:,.0f}",
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
    by = {(r["engine"], r["batch"]): r for r in results if "missing" not in r}
    fused = by.get(("fused", 1))
    found: list[tuple[str, str, bool]] = []
    if fused is not None:
        for engine, least in (("dopri5", 1000), ("diffrax Tsit5", 100), ("jax scan", 1)):
            other = by.get((engine, 1))
            if other is not None:
                ratio = other["forward_s"] / fused["forward_s"]
                text = f"at least {least} x {NAMES[engine]}, forward, B = 1"
                found.append((text, f"{ratio:,.0f} x", ratio >= least))
        ratio = fused["both_over_forward"]
        found.append(
            ("forward + backward at most 8 x forward, B = 1", f"{ratio:.1f} x", ratio <= 8)
        )
    many = by.get(("fused", 64))
    if many is not None:
        ratio, peak = many["both_over_forward"], many["peak_mb"] / 1024
        text = "forward + backward at most 8 x forward, B = 64"
        found.append((text, f"{ratio:.1f} x", ratio <= 8))
        text = "gradient of 64 rollouts of 330 s within 2 GB (peak of the whole process)"
        found.append((text, f"{peak:.2f} GB", peak <= 2))
    if by:
        worst = max(r["off"] for r in by.values())
        text = f"every engine's SRMSE within {SAME:g} % of the limit"
        found.append((text, f"{worst:.2f} %", worst <= SAME))
    return found


def _machine() -> str:
    names = ("torch", "warp-lang", "torchdiffeq", "jax", "diffrax", "numpy")
    versions = []
    for name in names:
        try:
            versions.append(f"{name} {importlib.metadata.version(name)}")
        except importlib.metadata.PackageNotFoundError:
            versions.append(f"{name} not installed")
    cpu = platform.processor() or platform.machine()
    info = Path("/proc/cpuinfo")
    if info.exists():
        rows = [row for row in info.read_text().splitlines() if row.startswith("model name")]
        cpu = rows[0].split(":")[1].strip() if rows else cpu
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()
    gpu = torch.cuda.get_device_name() if torch.cuda.is_available() else "no CUDA device"
    return f"{cpu}, {cores} cores, {gpu}; Python {platform.python_version()}, {', '.join(versions)}"


def _page(results: list[dict[str, Any]], found: Curves) -> str:
    body = [["what it must show", "here", ""]]
    body += [[text, value, "ok" if held else "NOT MET"] for text, value, held in verdicts(results)]
    cuda = "" if torch.cuda.is_available() else "No CUDA device was at hand: its rows are missing."
    return f"""# Benchmarks

Made by `make bench` on {time.strftime("%Y-%m-%d")}: {_machine()}.

One loop for every engine: soft attention, N = 10, 5 slots, scenario 1, draws 0 to B - 1, float64.
Times are per simulated second and trajectory; each line ran in a process of its own, on the stretch
it names, and `~` marks 330 s extrapolated from it. "With gradient" is forward and backward to all
constants. "Off" compares SRMSE of draw 0 with the limit over the same stretch.
Trust ratios within one run: the machine is shared. {cuda}

{_table(results)}

{aligned(body)}

## Cost against horizon and batch

{found.scaling_table}

![Cost against horizon and batch](docs/benchmark_scaling.png)

## Accuracy against work

Largest deviation of the SRMSE (whole run and t > 10 s, both joints, scenarios 1, 2, 4, 5, 6 of
330 s) from its limit, the W-method at 0.25 ms. `following` is the default: the reference's motion
enters the stages (`Implicit.follow_reference`).

{found.precision_table}

![Accuracy against work](docs/work_precision.png)
"""


if __name__ == "__main__":
    main()
