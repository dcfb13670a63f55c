"""A step as a C99 function: the statements that lanes get, with C's types and names."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import torch
from torch import Tensor

from ...errors import ExportError
from ..cpp.expressions import type_of
from ..cpp.plan import Output
from ..cpp.writer import Writer
from ..graph.nodes import reachable
from ..march.layout import Layout
from ..march.program import Program
from ..real import Real

#: Bytes of arrays that a step may keep on the stack.
STACK = 256 * 1024
#: What a step is given, by the kinds of its numbers; and what it writes.
GIVEN = {"constant": "f", "segment": "f", "whole": "i", "f": "f", "k": "i"}
RESULTS = {"f_out": "f", "k_out": "i"}
CONSTANTS = ("constant", "whole")
Place = tuple[str, int]
_CANNOT = {"clock": "the time", "noise": "random numbers"}


class CUnit(NamedTuple):
    """A function: its text as lanes have it, and the bytes of its arrays."""

    real: Real
    text: str
    stack: int = 0


class _Writer(Writer):
    """Constants lie where all that may be given lie, whether a step reads them or not."""

    def __init__(
        self, outputs: Sequence[Output], real: Real, places: Mapping[Place, Place]
    ) -> None:
        super().__init__(outputs, unroll=0, real=real)
        self._places = places

    def place(self, array: str, offset: int) -> Place:
        return self._places.get((array, offset), (array, offset))


def c99_function(program: Program, name: str, baked: str | None = None) -> CUnit:
    """The program's step: `static void NAME(constant, segment, whole, f, k, f_out, k_out)`.

    `constant` and `whole` hold all that the program may be given (`constants_in`), used or not; if
    `baked` says how, they are no parameters but arrays of the file, BAKEDconstant and BAKEDwhole.
    Results must not overlap with what is given. Raises `ExportError` for what C cannot say.
    """
    real = program.layout.real
    (outputs,) = program.scope.outputs
    _check(name, outputs)
    writer = _Writer(outputs, real, _places(program, baked or ""))
    lines = writer.text()
    arrays = writer.plan.arrays
    stack = sum(size for size, _ in arrays.values()) * real.bytes
    if stack > STACK:
        raise ExportError(
            f"{name}: its arrays take {stack // 1024} KiB; C keeps them on the stack, "
            f"{STACK // 1024} KiB at most"
        )
    tables = [
        f"static const {kind} {table}[] = {{{', '.join(values)}}};"
        for (kind, *values), table in writer.tables.items()
    ]
    declared = [f"{type_of(kind)} {array}[{n}];" for array, (n, kind) in arrays.items()]
    given = {
        array: kind for array, kind in GIVEN.items() if baked is None or array not in CONSTANTS
    }
    text = "\n".join(lines)
    unread = [
        f"(void){array};" for array in (*given, *RESULTS) if not re.search(rf"\b{array}\[", text)
    ]
    body = "\n".join(f"  {line}" for line in [*tables, *declared, *unread, *lines])
    parameters = [f"const {type_of(kind)}* restrict {array}" for array, kind in given.items()]
    parameters += [f"{type_of(kind)}* restrict {array}" for array, kind in RESULTS.items()]
    text = f"static void {name}({', '.join(parameters)}) {{\n{body}\n}}\n"
    return CUnit(real, text, stack)


def constants_in(layout: Layout, values: Sequence[Tensor]) -> tuple[Tensor, Tensor]:
    """All constants of a program's `given` as its two arrays: floating numbers, and others."""
    flat = [
        [v.reshape(-1) for v, c in zip(values, layout.constants, strict=True) if c.place == p]
        for p in ("constant", "shared", "whole")
    ]
    empty = [torch.zeros(0, dtype=layout.real.dtype), torch.zeros(0, dtype=torch.int64)]
    whole = [(-v.long() if v.dtype == torch.bool else v) for v in flat[2]]
    return torch.cat([*flat[0], *flat[1], empty[0]]), torch.cat([*whole, empty[1]])


def _places(program: Program, prefix: str) -> dict[Place, Place]:
    """Where what the step reads of the constants lies among all of them."""
    given, layout = program.given, program.layout
    own = given.size("constant")
    places = {}
    for i, place in zip(program.used, layout.constant_places, strict=True):
        array, offset = given.constant_places[i]
        if array == "shared":
            array, offset = "constant", offset + own
        if math.prod(given.constants[i].shape):
            places[place] = f"{prefix}{array}", offset
    return places


def _check(name: str, outputs: Sequence[Output]) -> None:
    for node in reachable([o.node for o in outputs]):
        if node.op == "input" and node.attributes[0] in _CANNOT:
            raise ExportError(f"{name} reads {_CANNOT[node.attributes[0]]}, which C code has not")
