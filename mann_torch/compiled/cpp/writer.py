"""C++ text of a planned graph: loops over elements, each element a vector of lanes."""

from __future__ import annotations

import math
from collections.abc import Sequence

from ..arithmetic import POINTWISE
from ..graph import IndexMap, Node, Shape
from .expressions import double, literal, text_of
from .plan import Group, Output, Plan, composed, linear, make_plan, reduced_maps
from .special import SPECIAL

#: A sum of this many terms to few results is split over several accumulators.
_LONG = 16
_FEW = 8


def type_of(kind: str) -> str:
    """V for float64, M for integers and masks."""
    return "V" if kind == "f" else "M"


class Writer:
    """Writes statements; `unroll` is how many turns a loop may have to be unrolled."""

    def __init__(self, outputs: Sequence[Output], unroll: int) -> None:
        self.plan: Plan = make_plan(outputs)
        self._unroll = unroll
        self._lines: list[str] = []
        self._depth = 0
        self._names: dict[int, str] = {}  # variables of the loop being written
        self._scalars: dict[int, str] = {}
        self.tables: dict[tuple[str, ...], str] = {}
        self._loops: list[str] = []
        self._outputs = outputs

    def text(self) -> list[str]:
        """All statements, without the arrays they need (`plan.arrays`, `tables`)."""
        for group in self.plan.groups:
            if group.nodes[0].op in SPECIAL:
                SPECIAL[group.nodes[0].op](self, group.nodes[0])
                self._finish(group.nodes[0])
            else:
                self._group(group)
        for output in self._outputs:
            home = self.plan.homes.get(output.node.number)
            if home != (output.place, output.offset):
                self._copy(output)
        return self._lines

    # -- statements ---------------------------------------------------------------------------

    def put(self, line: str) -> None:
        """One line."""
        self._lines.append("  " * self._depth + line)

    def open(self, variable: str, count: int, step: int = 1) -> None:
        """Begin a loop from 0 on."""
        if count <= self._unroll:
            self.put("#pragma unroll")
        end = f"{variable} + {step} <= {count}" if step > 1 else f"{variable} < {count}"
        self.put(f"for (int {variable} = 0; {end}; {variable} += {step}) {{")
        self._depth += 1

    def close(self) -> None:
        """End a loop."""
        self._depth -= 1
        self.put("}")

    def loop_over(self, shape: Shape, prefix: str = "i") -> tuple[list[str], list[IndexMap]]:
        """Open loops over a shape; the variables, and each dimension's index in terms of them."""
        moving = [d for d, n in enumerate(shape) if n != 1]
        names = [f"{prefix}{d}" for d in moving]
        for d, name in zip(moving, names, strict=True):
            self.open(name, shape[d])
        maps = [IndexMap(0, tuple(int(d == m) for m in moving)) for d in range(len(shape))]
        return names, maps

    def _group(self, group: Group) -> None:
        if not group.shape:
            for node in group.nodes:
                name = f"v{node.number}"
                self.put(f"{type_of(node.kind)} {name};")
                self._value(node, name, [], [IndexMap(0, ())] * len(node.shape))
                self._scalars[node.number] = name
                self._finish(node)
            return
        names = [f"i{d}" for d in range(len(group.shape))]
        for name, count in zip(names, group.shape, strict=True):
            self.open(name, count)
        for node in group.nodes:
            place = 0
            maps = []
            for n in node.shape:
                steps = tuple(int(n != 1 and k == place) for k in range(len(names)))
                maps.append(IndexMap(0, steps))
                place += n != 1
            name = f"v{node.number}"
            self.put(f"{type_of(node.kind)} {name};")
            self._value(node, name, names, maps)
            self._names[node.number] = name
            if node.number not in self.plan.passing:
                array, offset = self.plan.homes[node.number]
                self.put(
                    f"{array}[{index_text(*linear(maps, node.shape), names, offset)}] = {name};"
                )
        for _ in names:
            self.close()
        self._names = {}

    def _finish(self, node: Node) -> None:
        """A result of one element goes to its place too."""
        home = self.plan.homes.get(node.number)
        if node.size == 1 and home is not None and node.number in self._scalars:
            self.put(f"{home[0]}[{home[1]}] = {self._scalars[node.number]};")

    def _copy(self, output: Output) -> None:
        names, maps = self.loop_over(output.node.shape)
        where = index_text(*linear(maps, output.node.shape), names, output.offset)
        self.put(f"{output.place}[{where}] = {self.read(output.node, names, maps)};")
        for _ in names:
            self.close()

    # -- values -------------------------------------------------------------------------------

    def _value(self, node: Node, name: str, names: Sequence[str], maps: Sequence[IndexMap]) -> None:
        """Compute one element of a node into a variable."""
        if node.op in POINTWISE:
            self.put(f"{name} = {self._expression(node, names, maps)};")
        else:
            self._reduction(node, name, names, maps)

    def _reduction(
        self, node: Node, name: str, names: Sequence[str], maps: Sequence[IndexMap]
    ) -> None:
        (a,) = node.args
        counts = [a.shape[d] for d in node.attributes]
        inner = [f"r{node.number}_{k}" for k in range(len(counts))]
        variables = [*names, *inner]
        outer = [IndexMap(m.offset, m.steps + (0,) * len(inner)) for m in maps]
        outer += [
            IndexMap(0, (0,) * len(names) + tuple(int(k == j) for j in range(len(inner))))
            for k in range(len(inner))
        ]
        found = [composed(m, outer) for m in reduced_maps(node)]
        if node.op in ("argmax", "argmin"):
            self._arg_reduction(node, name, variables, inner[0], counts[0], found)
            return
        start, step = _REDUCE[node.op, node.kind if node.kind != "b" else "b"]
        long = node.op == "sum" and node.kind == "f" and math.prod(counts) >= _LONG
        if long and node.size <= _FEW and max(counts) >= 4:
            self._long_sum(node, name, variables, inner, counts, found)
            return
        self.put(f"{name} = {start};")
        for variable, count in zip(inner, counts, strict=True):
            self.open(variable, count)
        self.put(self._accumulate(node, name, variables, found, step))
        for _ in inner:
            self.close()

    def _accumulate(
        self, node: Node, name: str, names: Sequence[str], maps: Sequence[IndexMap], step: str
    ) -> str:
        (a,) = node.args
        if node.op == "sum" and node.kind == "f" and self._is_inline_product(a):
            left, right = (self.read(p, names, maps) for p in a.args)
            return f"{name} = fma({left}, {right}, {name});"
        return f"{name} = {step.format(name, self.read(a, names, maps))};"

    def _long_sum(
        self,
        node: Node,
        name: str,
        names: Sequence[str],
        inner: Sequence[str],
        counts: Sequence[int],
        maps: Sequence[IndexMap],
    ) -> None:
        """Several sums side by side: one alone would wait for each addition."""
        along = max(range(len(counts)), key=lambda k: (counts[k], k))
        last, count = inner[along], counts[along]
        width = 8 if count >= 8 else 4
        parts = [f"{name}_{k}" for k in range(width)]
        self.put(f"V {' = splat(0.0), '.join(parts)} = splat(0.0);")
        others = [(v, n) for v, n in zip(inner, counts, strict=True) if v != last]
        for variable, n in others:
            self.open(variable, n)
        place = list(names).index(last)
        self.open(last, count, width)
        for k, part in enumerate(parts):
            moved = [IndexMap(m.offset + k * m.steps[place], m.steps) for m in maps]
            self.put(self._accumulate(node, part, names, moved, "({0} + {1})"))
        self.close()
        for k, rest in enumerate(range(count - count % width, count)):
            fixed = [
                IndexMap(
                    m.offset + rest * m.steps[place],
                    tuple(0 if i == place else s for i, s in enumerate(m.steps)),
                )
                for m in maps
            ]
            self.put(self._accumulate(node, parts[k], names, fixed, "({0} + {1})"))
        for _ in others:
            self.close()
        while len(parts) > 1:
            half = len(parts) // 2
            parts = [f"({a} + {b})" for a, b in zip(parts[:half], parts[half:], strict=True)]
        self.put(f"{name} = {parts[0]};")

    def _arg_reduction(
        self,
        node: Node,
        name: str,
        names: Sequence[str],
        inner: str,
        count: int,
        maps: Sequence[IndexMap],
    ) -> None:
        (a,) = node.args
        kind, best, here = type_of(a.kind), f"{name}_best", f"{name}_here"
        place = list(names).index(inner)
        first = [
            IndexMap(m.offset, tuple(0 if i == place else s for i, s in enumerate(m.steps)))
            for m in maps
        ]
        self.put(f"{kind} {best} = {self.read(a, names, first)};")
        self.put(f"{name} = isplat(0);")
        self.open(inner, count)
        self.put(f"{kind} {here} = {self.read(a, names, maps)};")
        test = "gt" if node.op == "argmax" else "lt"
        if a.kind == "f":  # NaN comes first, as in torch
            better = f"({test}({here}, {best}) | (ne({here}, {here}) & eq({best}, {best})))"
            self.put(f"M {name}_take = {better};")
            self.put(f"{best} = sel({name}_take, {here}, {best});")
        else:
            self.put(f"M {name}_take = i{test}({here}, {best});")
            self.put(f"{best} = isel({name}_take, {here}, {best});")
        self.put(f"{name} = isel({name}_take, isplat({inner}), {name});")
        self.close()

    def _is_inline(self, node: Node) -> bool:
        return (
            node.op in POINTWISE
            and node.number not in self.plan.homes
            and node.number not in self._scalars
            and node.number not in self._names
        )

    def _is_inline_product(self, node: Node) -> bool:
        return node.op == "mul" and self._is_inline(node)

    def _expression(self, node: Node, names: Sequence[str], maps: Sequence[IndexMap]) -> str:
        """A pointwise node's text; a product that is added to something takes an fma."""
        if node.op in ("add", "sub") and node.kind == "f":
            a, b = node.args
            if self._is_inline_product(a):
                left, right = (self.read(p, names, maps) for p in a.args)
                sign = "" if node.op == "add" else "-"
                return f"fma({left}, {right}, {sign}{self.read(b, names, maps)})"
            if self._is_inline_product(b):
                left, right = (self.read(p, names, maps) for p in b.args)
                sign = "" if node.op == "add" else "-"
                return f"fma({sign}{left}, {right}, {self.read(a, names, maps)})"
        return text_of(node).format(*(self.read(a, names, maps) for a in node.args))

    def read(self, node: Node, names: Sequence[str], maps: Sequence[IndexMap]) -> str:
        """The element of a node at the indices `maps` of the loop variables `names`."""
        if node.op == "view":
            return self.read(node.args[0], names, [composed(m, maps) for m in node.attributes])
        if node.number in self._names:
            return self._names[node.number]
        if node.number in self._scalars:
            return self._scalars[node.number]
        if node.op == "full":
            return literal(node.kind, node.attributes[0])
        if node.op == "iota":
            start, step = node.attributes
            (m,) = maps
            steps = tuple(step * s for s in m.steps)
            return f"isplat({index_text(start + step * m.offset, steps, names, 0)})"
        offset, steps = linear(maps, node.shape)
        if node.op == "input":
            place, base = node.attributes
            where = index_text(offset, steps, names, base)
            return f"splat({place}[{where}])" if place == "clock" else f"{place}[{where}]"
        if node.op == "table":
            where = index_text(offset, steps, names, 0)
            return f"{'splat' if node.kind == 'f' else 'isplat'}({self._table(node)}[{where}])"
        if node.op == "reshape":
            source = node.args[0]
            if source.number in self._names:
                return self._names[source.number]
            if source.number in self._scalars:
                return self._scalars[source.number]
            if source.op == "input":
                place, base = source.attributes
                where = index_text(offset, steps, names, base)
                return f"splat({place}[{where}])" if place == "clock" else f"{place}[{where}]"
            node = source
        home = self.plan.homes.get(node.number)
        if home is not None:
            return f"{home[0]}[{index_text(offset, steps, names, home[1])}]"
        return self._expression(node, names, maps)

    def _table(self, node: Node) -> str:
        kind = "double" if node.kind == "f" else "long long"
        convert = double if node.kind == "f" else (lambda t: {"True": "-1", "False": "0"}.get(t, t))
        key = (kind, *(convert(text) for text in node.attributes))
        return self.tables.setdefault(key, f"t{len(self.tables)}")


_REDUCE = {
    ("sum", "f"): ("splat(0.0)", "({0} + {1})"),
    ("sum", "i"): ("isplat(0)", "({0} + {1})"),
    ("prod", "f"): ("splat(1.0)", "({0} * {1})"),
    ("prod", "i"): ("isplat(1)", "({0} * {1})"),
    ("amax", "f"): ("(-inf_())", "max_({0}, {1})"),
    ("amin", "f"): ("inf_()", "min_({0}, {1})"),
    ("amax", "i"): (f"isplat({-(2**63) + 1}ll)", "imax({0}, {1})"),
    ("amin", "i"): (f"isplat({2**63 - 1}ll)", "imin({0}, {1})"),
    ("amax", "b"): ("isplat(0)", "({0} | {1})"),
    ("amin", "b"): ("isplat(-1)", "({0} & {1})"),
    ("any", "b"): ("isplat(0)", "({0} | {1})"),
    ("all", "b"): ("isplat(-1)", "({0} & {1})"),
}


def index_text(offset: int, steps: Sequence[int], names: Sequence[str], base: int) -> str:
    """offset + base + sum of steps times variables; no steps: of an array without dimensions."""
    parts = []
    for step, name in zip(steps, names, strict=bool(steps)):
        if step:
            parts.append(name if step == 1 else f"{step} * {name}")
    if offset + base or not parts:
        parts.append(str(offset + base))
    return " + ".join(parts)
