"""One engine's ticks: `python -m experiments.benchmarking.deploy_ticks JSON`, a process each."""

from __future__ import annotations

import json
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor

import mann_torch as mt
from mann_torch.deployment.c_code.makefile import FLAGS
from mann_torch.deployment.runtimes import AotiTick, OnnxTick, to_aoti, to_onnx, to_torch_export
from mann_torch.deployment.runtimes.flat import INPUTS, OUTPUTS, FlatTick, Running

from .deploy_motion import TICKS, Recorded, recorded
from .deploy_programs import c_program, cpp_program, ran, torch_flags

#: Ticks before any is timed.
WARM = 200
#: How the C code is compiled, by what the table calls it.
C = {
    "C, gcc -O2": ("gcc", "-O2"),
    "C, gcc -O3 -march=native": ("gcc", "-O3", "-march=native"),
    "C, clang -O2": ("clang", "-O2"),
}
#: The package of AOTInductor without Python.
CPP = "AOTInductor, C++"
#: Of one tick after the other: what to call with a tick's number, and the last command.
Ticks = tuple[Callable[[int], None], Callable[[], Tensor]]


@dataclass(frozen=True)
class Line:
    """An engine, a controller, a precision."""

    engine: str
    controller: str
    dtype: str = "float64"


def measure(line: Line, ticks: int = TICKS) -> dict[str, Any]:
    """Microseconds of a tick, the command of the last one, bytes of what runs it."""
    torch.set_num_threads(1)
    made = recorded(line.controller, ticks)
    with tempfile.TemporaryDirectory() as room:
        start = time.perf_counter()
        if line.engine in C:
            found = in_c(made, line, Path(room))
        elif line.engine == CPP:
            found = in_cpp(made, Path(room))
        else:
            found = in_python(made, PYTHON[line.engine](made, Path(room)), start)
        files = [path for path in Path(room).rglob("controller.*") if path.is_file()]
        sizes = {path.name: path.stat().st_size for path in files}
    took = found.pop("took")
    return {**asdict(line), **times_of(took), "bytes": sizes, **found}


def times_of(took: Any) -> dict[str, float]:
    """Median, 99.9 percentile (of the quietest tenth, too) and largest of times (n,) [us]."""
    tenths = [float(np.quantile(part, 0.999)) for part in np.array_split(took, 10)]
    median, rare = (float(np.quantile(took, q)) for q in (0.5, 0.999))
    return {
        "median": median,
        "rare": rare,
        "rare_quiet": min(tenths),
        "most": float(took.max()),
        "ticks": len(took),
    }


def in_c(made: Recorded, line: Line, room: Path) -> dict[str, Any]:
    """`to_c`, compiled."""
    dtype = getattr(torch, line.dtype)
    stepper = made.stepper(dtype)
    ticks, code = len(made.reference), room / "c"
    start = time.perf_counter()
    stepper.to_c(code)
    (code / "ticks.c").write_text(c_program(ticks))
    compiler, *flags = C[line.engine]
    command = (compiler, *FLAGS, *flags)
    ran(code, *command, "-c", "controller.c", "-o", "controller.o")
    ran(code, *command, "ticks.c", "controller.o", "-o", "ticks", "-lm")
    built = time.perf_counter() - start
    _rows_to(code, made, dtype)
    (code / "state").write_bytes(stepper.to_bytes(made.start(stepper)))
    ran(code, "./ticks")
    text, data, bss = map(int, ran(code, "size", "controller.o").splitlines()[1].split()[:3])
    kind = np.float64 if dtype == torch.float64 else np.float32
    return {
        "took": np.fromfile(code / "took"),
        "input": np.fromfile(code / "input", kind).tolist(),
        "first_s": built,
        "code": text,
        "data": data + bss,
        "state": 8 * stepper.size if dtype == torch.float64 else 4 * stepper.size,
    }


def in_cpp(made: Recorded, room: Path) -> dict[str, Any]:
    """AOTInductor's package as C++ loads it."""
    stepper = made.stepper(torch.float64)
    start = time.perf_counter()
    to_aoti(stepper, room / "controller.pt2")
    built = time.perf_counter() - start
    blob, ports = stepper.blob, stepper.ports
    sizes = {"R": len(ports.reference), "Y": len(ports.measurement), "F": blob.n_f, "K": blob.n_k}
    (room / "ticks.cpp").write_text(cpp_program(len(made.reference), sizes))
    ran(room, "g++", "-std=c++20", "-O1", "ticks.cpp", "-o", "ticks", *torch_flags())
    _rows_to(room, made, torch.float64)
    for name, x in zip(("state_f", "state_k"), blob.split(made.start(stepper)), strict=True):
        (room / name).write_bytes(x.numpy().tobytes())
    ran(room, "./ticks")
    found = {"took": np.fromfile(room / "took"), "input": np.fromfile(room / "input").tolist()}
    return {**found, "first_s": built}


def _rows_to(folder: Path, made: Recorded, dtype: torch.dtype) -> None:
    for name, x in (("reference", made.reference), ("measurement", made.measurement)):
        (folder / name).write_bytes(x.to(dtype).contiguous().numpy().tobytes())


def in_python(made: Recorded, sides: Ticks, start: float) -> dict[str, Any]:
    """Ticks called from Python, one by one."""
    tick, last = sides
    tick(0)
    first = time.perf_counter() - start
    # A few more that do not count, and the state as it was.
    for i in range(1, WARM):
        tick(i)
    took = np.empty(len(made.reference) - WARM)
    for i in range(WARM, len(made.reference)):
        before = time.perf_counter_ns()
        tick(i)
        took[i - WARM] = 1e-3 * (time.perf_counter_ns() - before)
    return {"took": took, "input": last().tolist(), "first_s": first}


def _stepper(engine: str) -> Callable[[Recorded, Path], Ticks]:
    def made_of(made: Recorded, room: Path) -> Ticks:
        stepper = made.stepper(torch.float64, engine)
        if engine == "compiled":  # of its size alone
            to_torch_export(stepper, room / "controller.pt2")
        reference, measurement = made.reference.unbind(0), made.measurement.unbind(0)
        done = mt.deployment.Stepped(torch.empty(0), made.start(stepper), 0)

        def tick(i: int) -> None:
            nonlocal done
            done = stepper.step(done.state, reference[i], measurement[i])

        return tick, lambda: done.input

    return made_of


def _flat(make: Callable[[mt.Stepper, Path], Running]) -> Callable[[Recorded, Path], Ticks]:
    def made_of(made: Recorded, room: Path) -> Ticks:
        stepper = made.stepper(torch.float64)
        running, adapt = make(stepper, room), torch.tensor(True)
        reference, measurement = made.reference.unbind(0), made.measurement.unbind(0)
        (f, k), u = stepper.blob.split(made.start(stepper)), torch.empty(0)

        def tick(i: int) -> None:
            nonlocal f, k, u
            u, _, f, k = running(f, k, reference[i], measurement[i], adapt)

        return tick, lambda: u

    return made_of


def _torch_compile(stepper: mt.Stepper, room: Path) -> Running:
    compiled = torch.compile(FlatTick(stepper).eval(), fullgraph=True, dynamic=False)

    def running(*given: Tensor) -> Any:
        with torch.no_grad():
            return compiled(*given)

    return running


def _onnx(made: Recorded, room: Path) -> Ticks:
    """onnxruntime as those call it who have no torch."""
    stepper = made.stepper(torch.float64)
    session = OnnxTick(to_onnx(stepper, room / "controller.onnx")).session
    reference, measurement = made.reference.numpy(), made.measurement.numpy()
    f, k = (x.numpy() for x in stepper.blob.split(made.start(stepper)))
    adapt, u = np.array(True), np.empty(0)

    def tick(i: int) -> None:
        nonlocal f, k, u
        given = dict(zip(INPUTS, (f, k, reference[i], measurement[i], adapt), strict=True))
        u, _, f, k = session.run(OUTPUTS, given)

    return tick, lambda: torch.as_tensor(u)


#: Engines that Python calls.
PYTHON: dict[str, Callable[[Recorded, Path], Ticks]] = {
    "compiled, Python": _stepper("compiled"),
    "AOTInductor, Python": _flat(lambda s, room: AotiTick(to_aoti(s, room / "controller.pt2"))),
    "torch.compile": _flat(_torch_compile),
    "ONNX, onnxruntime": _onnx,
    "eager": _stepper("torch"),
}


if __name__ == "__main__":
    *line, ticks = json.loads(sys.argv[1])
    print(json.dumps(measure(Line(*line), ticks)))
