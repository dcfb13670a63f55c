"""The whole text of a kernel: lanes, step, its vector-Jacobian product, and the time loop."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

from ..cpp.expressions import type_of
from ..cpp.outer import KEEP, Outers, outer_text
from ..cpp.plan import Output
from ..cpp.writer import Writer
from ..lanes.library import lane_library
from ..lanes.linear import linear_library
from ..lanes.types import lane_types
from .layout import Layout
from .loop_forms import marched, turned
from .loop_text import AFTER, BACKWARD, COMMON, FINE, FORWARD, GATHER, TOOLS
from .turn_text import turn_text
from .watch_text import beyond_text, why_text

#: Bytes of arrays that a step may keep on the stack; beyond that they lie in the caller's memory.
STACK = 256 * 1024
#: Turns of a loop that are written out, by number of lanes.
_UNROLL = {1: 16, 2: 8, 4: 4, 8: 4, 16: 4}
#: Bytes of vectors where there are 32 of them in registers, not 16.
_MANY = 64
_GIVEN = (
    "const $REAL* __restrict__ clock, const V* __restrict__ constant, "
    "const V* __restrict__ segment, const V* __restrict__ noise, const M* __restrict__ whole, "
    "const V* __restrict__ f, const M* __restrict__ k"
)
_RESULTS = "V* __restrict__ f_out, M* __restrict__ k_out"
_GRADIENTS = "V* __restrict__ adj_out, V* __restrict__ g_constant, V* __restrict__ g_segment"


class KernelText(NamedTuple):
    """C++ for the body of a function of (table, g, first, last), and the memory it needs."""

    text: str
    #: Vectors of lanes that `table` must offer as working memory, apart from STRIDE / FINE states.
    heap: int


class Sizes(NamedTuple):
    """How many numbers of what is differentiated have gradients."""

    wanted: int = 0
    wanted_segment: int = 0
    wanted_shared: int = 0
    #: Those that grow by outer products.
    outers: Outers = Outers()
    #: From one row of segments' gradients to the next, where they lie in rows.
    wide_segment: int = 0

    @property
    def total(self) -> int:
        """Vectors of a step's own part of them, and of factors that are kept."""
        own = self.wanted + self.wanted_segment + self.wanted_shared
        return own + KEEP * self.outers.width


class Function(NamedTuple):
    """A struct with one function `run`, of what its outputs are."""

    name: str
    outputs: Sequence[Output]
    #: Arrays it takes before and writes after those that all take, and the kinds of their numbers.
    takes: tuple[tuple[str, str], ...] = ()
    gives: tuple[str, ...] = ()
    backward: bool = False


class Skeleton(NamedTuple):
    """C++ text that makes the functions `Step` and `Back` of other functions."""

    numbers: Mapping[str, int]
    forward: str
    backward: str
    #: Vectors of working memory each wants besides what the functions do.
    room: int
    room_backward: int


def forward_text(
    layout: Layout, functions: Sequence[Function], lanes: int, skeleton: Skeleton | None = None
) -> KernelText:
    """The forward march."""
    bodies, room = _written(functions, lanes, layout)
    watch = FORWARD.replace("$BEYOND", beyond_text(layout)).replace("$WHY", why_text(layout))
    if skeleton is not None:
        bodies.append(skeleton.forward)
        room += skeleton.room
    head = _head(layout, lanes, Sizes(), skeleton)
    loop = _marched([TOOLS, COMMON, watch], layout, lanes)
    text = "\n".join([head, *bodies, *loop, "}"])
    return KernelText(text, _common_room(layout) + room)


def backward_text(
    layout: Layout,
    functions: Sequence[Function],
    sizes: Sizes,
    lanes: int,
    skeleton: Skeleton | None = None,
) -> KernelText:
    """The backward march."""
    bodies, room = _written(functions, lanes, layout)
    walk = BACKWARD.replace("$AFTER", "" if skeleton is None else AFTER)
    walk = walk.replace("$LAST", "end - 1" if skeleton is None else "end")
    if skeleton is not None:
        bodies += [skeleton.forward, skeleton.backward]
        room += max(skeleton.room, skeleton.room_backward)
    head = _head(layout, lanes, sizes, skeleton)
    loop = _marched([TOOLS, GATHER, COMMON, walk], layout, lanes)
    text = "\n".join([head, *bodies, *_outer(layout, sizes, lanes), *loop, "}"])
    f, k = layout.size("f"), layout.size("k")
    again = sizes.wanted_segment if is_turned(layout) else 0
    own = f + sizes.total + again + (FINE + 1) * (f + k)
    return KernelText(text, _common_room(layout) + own + room)


def _marched(parts: Sequence[str], layout: Layout, lanes: int) -> list[str]:
    turn = [turn_text(lanes)] if is_turned(layout) else []
    return [marched(part, layout.real, layout.size("shared") > 0) for part in [*turn, *parts]]


def is_turned(layout: Layout) -> bool:
    """Whether segments and outputs lie as rows, a sample each, not in lanes."""
    return turned(layout.real, layout.size("shared") > 0)


def _common_room(layout: Layout) -> int:
    segment = layout.size("segment") if is_turned(layout) else 0
    return layout.size("f") + layout.size("k") + layout.size("noise") + segment


def _head(layout: Layout, lanes: int, sizes: Sizes, skeleton: Skeleton | None) -> str:
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
        **({"N_WIDE_SEGMENT": sizes.wide_segment} if is_turned(layout) else {}),
        **(_shared_numbers(sizes) if layout.size("shared") else {}),
        **({} if skeleton is None else skeleton.numbers),
    }
    constants = ", ".join(f"{name} = {value}" for name, value in numbers.items())
    return "\n".join(
        [
            "{  // where a compound statement begins, the pragma may stand",
            "#if defined(__clang__)",
            "#pragma clang fp contract(off)",
            "#endif",
            lane_types(lanes, layout.real),
            f"enum {{ {constants} }};",
            "struct Lanes {",
            lane_library(lanes, "CUDA_CALLABLE", layout.real),
            linear_library(lanes, "CUDA_CALLABLE"),
            "};",
        ]
    )


def _shared_numbers(sizes: Sizes) -> dict[str, int]:
    return {"N_WANTED_SHARED": sizes.wanted_shared, "N_KEPT": sizes.outers.width, "KEEP": KEEP}


def _outer(layout: Layout, sizes: Sizes, lanes: int) -> list[str]:
    if not layout.size("shared"):
        return []
    tile = (4, 4) if lanes * layout.real.bytes >= _MANY else (4, 2)
    return [outer_text(sizes.outers, sizes.wanted_shared, tile)]


def _written(functions: Sequence[Function], lanes: int, layout: Layout) -> tuple[list[str], int]:
    """Their texts, and the vectors of memory that the greediest wants from its caller."""
    found = [_struct(function, lanes, layout) for function in functions]
    return [text for text, _ in found], max(room for _, room in found)


def _struct(function: Function, lanes: int, layout: Layout) -> tuple[str, int]:
    real, shared = layout.real, layout.size("shared") > 0
    writer = Writer(function.outputs, _UNROLL[lanes], real, turned(real, shared))
    lines = writer.text()
    arrays = writer.plan.arrays
    total = sum(size for size, _ in arrays.values())
    declared, room = [], 0
    if total * real.bytes * lanes <= STACK:
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
    parameters = [f"const {type_of(kind)}* __restrict__ {name}" for name, kind in function.takes]
    parameters.append(_GIVEN.replace("$REAL", real.name))
    if shared:
        parameters.append(f"const {real.name}* __restrict__ shared")
    if function.backward:
        parameters.append("const V* __restrict__ adj")
    parameters.append(_GRADIENTS if function.backward else _RESULTS)
    if shared and function.backward:
        parameters.append("V* __restrict__ g_shared")
    parameters += [f"V* __restrict__ {name}" for name in function.gives]
    text = f"""struct {function.name} : Lanes {{
#if defined(__clang__) && !defined(__CUDA_ARCH__)
  __attribute__((noinline))
#endif
  static CUDA_CALLABLE void run({", ".join(parameters)}, V* __restrict__ heap) {{
#if defined(__clang__)
#pragma clang fp contract(off)
#endif
{body}
  }}
}};"""
    return text, room
