"""The memory's sequences and streams beside torch's own recurrent layers:
`python -m experiments.benchmarking.memory JSON`, each line in a process of its own.
"""

from __future__ import annotations

import json
import sys
import tempfile
import time
from collections.abc import Callable
from typing import Any

import torch
from torch import nn

import mann_torch as mt

from ..runs.writing import aligned
from .measure import MISSING, Section, Times, in_process, in_turns, ratio_of, reasons, verdict

#: What the issue of its time asked for.
STEPS, BATCH, INPUTS, HIDDEN, SLOTS = 200, 32, 16, 64, 8
ROUNDS, STREAM = 15, 2000
#: At most so many times `nn.LSTM`, `nn.LSTMCell`; seconds of a first sequence from nothing.
SEQUENCE, SINGLE, COLD = 2.0, 1.0, 5.0
CELLS: dict[str, Callable[[], mt.MemoryCell]] = {
    "default": lambda: mt.MemoryCell(INPUTS, HIDDEN, SLOTS),
    "paper, soft": lambda: _paper(mt.SoftAttention()),
    "paper, hard": lambda: _paper(mt.HardAttention()),
    "paper, reallocating": lambda: _paper(mt.ReallocatingAttention("always")),
}


def _paper(attention: mt.Attention) -> mt.MemoryCell:
    return mt.MemoryCell.paper(INPUTS, HIDDEN, SLOTS, attention)


def sequences(name: str) -> dict[str, Any]:
    """Microseconds forward + backward of cell and `nn.LSTM`, in turns; the first one's seconds."""
    torch.manual_seed(0)
    layer, cell = nn.LSTM(INPUTS, HIDDEN), CELLS[name]()
    sequence, x = mt.MemorySequence(cell), torch.randn(STEPS, BATCH, INPUTS)

    def both(model: nn.Module) -> None:
        model.zero_grad()
        model(x)[0].sum().backward()

    start = time.perf_counter()
    both(sequence)
    cold = time.perf_counter() - start
    both(layer)
    sides = {"memory": (lambda: both(sequence), 1), "lstm": (lambda: both(layer), 1)}
    return {"cell": name, "cold_s": cold, **_each(in_turns(sides, ROUNDS))}


def streams(name: str) -> dict[str, Any]:
    """Microseconds a step of one sample, of a stream and of `nn.LSTMCell`, in turns."""
    torch.manual_seed(0)
    stream, peer = mt.MemoryStream(CELLS[name](), 1), nn.LSTMCell(INPUTS, HIDDEN)
    x = torch.randn(1, INPUTS)

    def ours() -> None:
        state = stream.initial_state()
        for _ in range(STREAM):
            _, state = stream(x, state)

    @torch.no_grad()
    def theirs() -> None:
        held = torch.zeros(1, HIDDEN), torch.zeros(1, HIDDEN)
        for _ in range(STREAM):
            held = peer(x, held)

    sides = {"memory": (ours, STREAM), "lstm": (theirs, STREAM)}
    return {"cell": name, **_each(in_turns(sides, ROUNDS))}


def _each(times: dict[str, Times]) -> dict[str, tuple[float, ...]]:
    return {name: found.each for name, found in times.items()}


def rows(results: list[dict[str, Any]], most: float) -> list[list[str]]:
    """The table's lines under a head."""
    head = ["cell", "memory, us", "torch, us", "ratio", "at most", ""]
    cold = "cold_s" in results[0]
    body = [[*head, "first, from nothing", "at most", ""] if cold else head]
    for result in results:
        if "missing" in result:
            body.append([result["cell"], MISSING, *[""] * (len(body[0]) - 2)])
            continue
        mine, theirs = (Times(tuple(result[name])) for name in ("memory", "lstm"))
        ratio, shown = ratio_of(mine, theirs)
        line = [result["cell"], str(mine), str(theirs), shown, f"{most:g}", verdict(ratio <= most)]
        if cold:
            seconds = result["cold_s"]
            line += [f"{seconds:.1f} s", f"{COLD:g} s", verdict(seconds <= COLD)]
        body.append(line)
    return body


def section() -> Section:
    """Sequences and streams of every cell."""
    found: dict[str, list[dict[str, Any]]] = {"sequences": [], "streams": []}
    for name in CELLS:
        with tempfile.TemporaryDirectory() as folder:
            for kind, results in found.items():
                made = in_process("memory", [kind, name], WARP_CACHE_PATH=folder)
                results.append({"cell": name, **made})
    text = f"""A sequence of {STEPS} steps, B = {BATCH}, hidden {HIDDEN}, {SLOTS} slots, inputs
{INPUTS}, float32, forward + backward, beside `nn.LSTM` of that size; median (and least) of {ROUNDS}
rounds in turns. "From nothing": the first sequence of a process with an empty folder of kernels,
tracing and compiling forwards and backwards.

{aligned(rows(found["sequences"], SEQUENCE))}{reasons(found["sequences"])}

One step of one sample a call, `MemoryStream` beside `nn.LSTMCell` under `no_grad`:

{aligned(rows(found["streams"], SINGLE))}{reasons(found["streams"])}"""
    return Section(text, [*found["sequences"], *found["streams"]])


if __name__ == "__main__":
    kind, name = json.loads(sys.argv[1])
    print(json.dumps({"sequences": sequences, "streams": streams}[kind](name)))
