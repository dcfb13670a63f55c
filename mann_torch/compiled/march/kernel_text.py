"""The whole text of a kernel: lanes, step, its vector-Jacobian product, and the time loop."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import NamedTuple

from ..cpp.expressions import type_of
from ..cpp.plan import Output
from ..cpp.writer import Writer
from ..lanes.library import lane_library
from ..lanes.linear import linear_library
from ..lanes.types import lane_types
from .layout import Layout
from .loop_text import BACKWARD, COMMON, FINE, FORWARD, GATHER, TOOLS

#: Bytes of arrays that a step may keep on the stack; beyond that they lie in the caller's memory.
STACK = 256 * 1024
#: Turns of a loop that are written out, by number of lanes.
_UNROLL = {1: 16, 2: 8, 4: 4, 8: 4}
_SIGNATURE = (
    "const double* __restrict__ clock, const V* __restrict__ constant, "
    "const V* __restrict__ segment, const V* __restrict__ noise, const M* __restrict__ whole, "
    "const V* __restrict__ f, const M* __restrict__ k"
)


class KernelText(NamedTuple):
    """C++ for the body of a function of (table, g, first, last), and the memory it needs."""

    text: str
    #: Vectors of lanes that `table` must offer as working memory, apart from STRIDE / FINE states.
    heap: int


class Sizes(NamedTuple):
    """How many numbers of what is differentiated have gradients."""

    wanted: int = 0
    wanted_segment: int = 0


def forward_text(layout: Layout, step: Sequence[Output], lanes: int) -> KernelText:
    """The forward march."""
    body, room = _function("Step", _SIGNATURE, _RESULTS, step, lanes)
    watch = FORWARD.replace("$BEYOND", _beyond(layout)).replace("$WHY", _why(layout))
    text = "\n".join([_head(layout, lanes, Sizes()), body, TOOLS, COMMON, watch, "}"])
    return KernelText(text, _common_room(layout) + room)


def backward_text(
    layout: Layout, step: Sequence[Output], back: Sequence[Output], sizes: Sizes, lanes: int
) -> KernelText:
    """The backward march."""
    forward, room = _function("Step", _SIGNATURE, _RESULTS, step, lanes)
    reverse, more = _function(
        "Back", _SIGNATURE + ", const V* __restrict__ adj", _GRADIENTS, back, lanes
    )
    text = "\n".join(
        [_head(layout, lanes, sizes), forward, reverse, TOOLS, GATHER, COMMON, BACKWARD, "}"]
    )
    f, k = layout.size("f"), layout.size("k")
    own = f + sizes.wanted + sizes.wanted_segment + (FINE + 1) * (f + k)
    return KernelText(text, _common_room(layout) + own + max(room, more))


_RESULTS = "V* __restrict__ f_out, M* __restrict__ k_out"
_GRADIENTS = "V* __restrict__ adj_out, V* __restrict__ g_constant, V* __restrict__ g_segment"


def _common_room(layout: Layout) -> int:
    return layout.size("f") + layout.size("k") + layout.size("noise")


def _head(layout: Layout, lanes: int, sizes: Sizes) -> str:
    numbers: Mapping[str, int] = {
        "LANES": lanes,
        "FINE": FINE,
        "N_CLOCK": layout.clock,
        "N_CONSTANT": layout.size("constant"),
        "N_WHOLE": layout.size("whole"),
        "N_SEGMENT": layout.size("segment"),
        "N_NOISE": layout.size("noise"),
        "N_F": layout.size("f"),
        "N_K": layout.size("k"),
        "N_MOTION": layout.n_motion,
        "N_WANTED": sizes.wanted,
        "N_WANTED_SEGMENT": sizes.wanted_segment,
    }
    constants = ", ".join(f"{name} = {value}" for name, value in numbers.items())
    return "\n".join(
        [
            "{  // where a compound statement begins, the pragma may stand",
            "#if defined(__clang__)",
            "#pragma clang fp contract(off)",
            "#endif",
            lane_types(lanes),
            f"enum {{ {constants} }};",
            "struct Lanes {",
            lane_library(lanes, "CUDA_CALLABLE"),
            linear_library("CUDA_CALLABLE"),
            "};",
        ]
    )


def _function(
    name: str, signature: str, results: str, outputs: Sequence[Output], lanes: int
) -> tuple[str, int]:
    """A struct with one function `run`, and the vectors of memory it wants from its caller."""
    writer = Writer(outputs, _UNROLL[lanes])
    lines = writer.text()
    arrays = writer.plan.arrays
    total = sum(size for size, _ in arrays.values())
    declared, room = [], 0
    if total * 8 * lanes <= STACK:
        declared = [f"{type_of(kind)} {array}[{n}];" for array, (n, kind) in arrays.items()]
    else:
        for array, (n, kind) in arrays.items():
            kind = type_of(kind)
            declared.append(f"{kind}* const __restrict__ {array} = ({kind}*)(heap + {room});")
            room += n
    tables = [
        f"const {kind} {table}[] = {{{', '.join(values)}}};"
        for (kind, *values), table in writer.tables.items()
    ]
    body = "\n".join(f"    {line}" for line in [*tables, *declared, *lines])
    text = f"""struct {name} : Lanes {{
#if defined(__clang__) && !defined(__CUDA_ARCH__)
  __attribute__((noinline))
#endif
  static CUDA_CALLABLE void run({signature}, {results}, V* __restrict__ heap) {{
#if defined(__clang__)
#pragma clang fp contract(off)
#endif
{body}
  }}
}};"""
    return text, room


def _ranges(layout: Layout) -> list[tuple[int, int, int]]:
    """First and last place in `f` of each watched leaf, and its number among them."""
    found = []
    for number, i in enumerate(layout.watched):
        _, offset = layout.carry_places[i]
        found.append((number, offset, offset + math.prod(layout.carry[i].shape)))
    return found


def _beyond(layout: Layout) -> str:
    lines = []
    for _, first, last in _ranges(layout):
        test = "bad = bad | ~lt(abs_(f[e]), splat(limit));"
        lines.append(f"for (int e = {first}; e < {last}; ++e) {test}")
    return "\n    ".join(lines)


def _why(layout: Layout) -> str:
    lines = ["int found = 0;"]
    for number, first, last in _ranges(layout):
        lines.append(f"found = leaf(f, l, limit, {first}, {last});")
        lines.append(f"if (found) return {10 * number} + found;")
    return "\n    ".join(lines)
