"""Ticks of deployed controllers in every runtime: C beside AOTInductor, ONNX and torch."""

from __future__ import annotations

import importlib.util
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from ..runs.writing import aligned
from .deploy_motion import TICKS
from .deploy_ticks import CPP, PYTHON, WARM, C, Line
from .measure import MISSING, Section, in_process, verdict
from .row import PAPER

#: At most so many us in C for the paper's controller in float64: median, 99.9 percentile.
MEDIAN, RARE = 2.0, 20.0
CONTROLLERS = {PAPER: "reallocating, N = 10, 5 slots", "nn": "plain network, N = 14"}
#: Engines of which a tick takes milliseconds.
FEWER = {"eager": TICKS // 10}
#: What the others are compared with.
OURS, ONNX, FIRST = "compiled, Python", "ONNX, onnxruntime", next(iter(C))
#: Published for two axes elsewhere [us].
PUBLISHED = "L1 in 0.49 us, MRAC in 2.27 us"
MB = 1e6


def lines() -> list[Line]:
    """Every engine in float64, C in float32 too."""
    found = []
    for controller in CONTROLLERS:
        found += [Line(name, controller, dtype) for name in C for dtype in ("float64", "float32")]
        found += [Line(name, controller) for name in (*PYTHON, CPP)]
    return found


def section() -> Section:
    """Times of ticks, what C takes, and what each runtime needs."""
    results = []
    for line in lines():
        ticks = FEWER.get(line.engine, TICKS)
        found = in_process("deploy_ticks", [line.engine, line.controller, line.dtype, ticks])
        results.append(
            {"engine": line.engine, "controller": line.controller, "dtype": line.dtype} | found
        )
    return Section(text_of(results), results)


def text_of(results: Sequence[dict[str, Any]]) -> str:
    """The section."""
    return f"""A tick of a deployed two-joint controller: reference and measurement in, torques out,
adaptation and memory moved on by 1 ms. Ticks are taken and timed one by one, {TICKS:,} of them
({FEWER["eager"]:,} in eager torch), on one thread, of the motion of scenario 1 under that
controller as simulated at 1 kHz. The machine is shared and its kernel no real-time one: other
programs are in the 99.9th percentile (in brackets that of the quietest tenth of the ticks) and in
the largest time. C is timed in a C program, the clock's own time in it, and "C++" in one that has
libtorch; the others as Python calls them, the first {WARM} ticks not counted. "torch.compile" is of
the default mode: "reduce-overhead" and "max-autotune" are no faster on a CPU. "Off" compares the
last command with the compiled engine's.

{aligned(rows(results))}{missing(results)}

{aligned(aims(results))}

Published elsewhere, on another machine, for controllers without a memory: {PUBLISHED} for two axes.

The object file of the C code, and the state that a controller keeps:

{aligned(sizes(results))}

What each needs where it runs:

{aligned(needs(results))}"""


def _of(results: Sequence[dict[str, Any]], **wanted: str) -> dict[str, Any]:
    return next((r for r in results if all(r[name] == value for name, value in wanted.items())), {})


def rows(results: Sequence[dict[str, Any]]) -> list[list[str]]:
    """The table of times."""
    head = ["controller", "runtime", "", "median, us", "99.9 %", "largest", "of C", "off"]
    body = [[*head, "first tick after"]]
    for r in results:
        line = [CONTROLLERS[r["controller"]], r["engine"], r["dtype"]]
        if "missing" in r:
            body.append([*line, MISSING, *[""] * 5])
            continue
        same = {"controller": r["controller"], "dtype": "float64"}
        ratio, off = _of(results, engine=FIRST, **same), _of(results, engine=OURS, **same)
        body.append(
            [
                *line,
                f"{r['median']:.3g}",
                f"{r['rare']:.3g} ({r['rare_quiet']:.3g})",
                f"{r['most']:,.0f}",
                f"{r['median'] / ratio['median']:.3g} x" if "median" in ratio else "",
                _off(r, off),
                f"{r['first_s']:.1f} s",
            ]
        )
    return body


def _off(one: dict[str, Any], other: dict[str, Any]) -> str:
    """Relative difference of the last commands, of as many ticks."""
    if "input" not in other or one["ticks"] < other["ticks"]:
        return ""
    scale = max(abs(x) for x in other["input"])
    apart = max(abs(a - b) for a, b in zip(one["input"], other["input"], strict=True))
    return f"{apart / scale:.0e}"


def missing(results: Sequence[dict[str, Any]]) -> str:
    """Why lines were not measured."""
    why = {(r["engine"], r["missing"]) for r in results if "missing" in r}
    return "".join(f"\n\n{MISSING}, {engine}: {reason}" for engine, reason in sorted(why))


def aims(results: Sequence[dict[str, Any]]) -> list[list[str]]:
    """What it must show."""
    body = [["what it must show, of the paper's controller in float64", "here", ""]]
    for name in C:
        found = _of(results, engine=name, controller=PAPER, dtype="float64")
        for what, key, most in (("median", "median", MEDIAN), ("99.9 %", "rare", RARE)):
            label = f"{name}: {what} at most {most:g} us"
            if key in found:
                body.append([label, f"{found[key]:.2f} us", verdict(found[key] <= most)])
            else:
                body.append([label, MISSING, verdict(False)])
    return body


def sizes(results: Sequence[dict[str, Any]]) -> list[list[str]]:
    """Bytes of code, data and state."""
    body = [["controller", "compiled by", "", "code and constants", "data", "state"]]
    for r in results:
        if "code" in r:
            numbers = [f"{r[name]:,} bytes" for name in ("code", "data", "state")]
            body.append([CONTROLLERS[r["controller"]], r["engine"], r["dtype"], *numbers])
    return body


def needs(results: Sequence[dict[str, Any]]) -> list[list[str]]:
    """What makes and what runs each file, and sizes here."""
    torch_mb = _mb("torch", "lib", ("libtorch_cpu.so", "libtorch.so", "libc10.so"))
    onnx_mb = _mb("onnxruntime", "capi", ("onnxruntime_pybind11_state*",))

    def size(engine: str, name: str) -> str:
        found = _of(results, engine=engine, controller=PAPER).get("bytes", {})
        return f"{found[name] / 1e3:,.0f} kB" if name in found else MISSING

    package = size("AOTInductor, Python", "controller.pt2")
    return [
        ["runtime", "to make its file", "the file", "to run it", "libraries"],
        ["C", "-", size(FIRST, "controller.c"), "a C99 compiler; libm, or nothing", "-"],
        ["torch.export", "torch", size(OURS, "controller.pt2"), "Python and torch", torch_mb],
        ["AOTInductor", "torch, a C++ compiler", package, "libtorch, as made with", torch_mb],
        ["ONNX", "extra `deploy`", size(ONNX, "controller.onnx"), "onnxruntime", onnx_mb],
    ]


def _mb(package: str, folder: str, names: Sequence[str]) -> str:
    """Size of a package's libraries."""
    found = importlib.util.find_spec(package)
    if found is None or found.origin is None:
        return "not installed"
    place = Path(found.origin).parent / folder
    files = [path for name in names for path in place.glob(name)]
    return f"{sum(path.stat().st_size for path in files) / MB:,.0f} MB"
