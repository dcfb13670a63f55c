"""C++ text of a planned graph: loops over elements, each element a vector of lanes."""

from __future__ import annotations

from collections.abc import Sequence

from ..graph.arithmetic import POINTWISE
from ..graph.nodes import IndexMap, Node, Shape
from ..real import DOUBLE, Real
from .expressions import literal, number, text_of, type_of, whole
from .indices import composed, index_text, linear
from .plan import SUMS, Group, Output, Plan, make_plan
from .products import write_product
from .reductions import write_reduction
from .special import SPECIAL

#: Arrays of numbers that all samples share.
ALIKE = ("clock", "shared")


class Writer:
    """Writes statements; `unroll` is how many turns a loop may have to be unrolled."""

    def __init__(
        self, outputs: Sequence[Output], unroll: int, real: Real = DOUBLE, blocks: bool = False
    ) -> None:
        self.real = real
        self.plan: Plan = make_plan(outputs, blocks)
        self._unroll = unroll
        self._lines: list[str] = []
        self._depth = 0
        self._names: dict[int, str] = {}  # variables of the loop being written
        self._scalars: dict[int, str] = {}
        self.tables: dict[tuple[str, ...], str] = {}
        self._outputs = outputs

    def text(self) -> list[str]:
        """All statements, without the arrays they need (`plan.arrays`, `tables`)."""
        for group in self.plan.groups:
            first = group.nodes[0]
            if first.op in SPECIAL:
                SPECIAL[first.op](self, first)
                self._finish(first)
            elif first.number in self.plan.products:
                write_product(self, first)
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
            home = self.plan.homes.get(node.number)
            if home is not None and home[0] == SUMS and node.op == "mul":
                where = f"{SUMS}[{index_text(*linear(maps, node.shape), names, home[1])}]"
                left, right = (self.read(a, names, maps) for a in node.args)
                self.put(f"{where} = fma({left}, {right}, {where});")
                continue
            name = f"v{node.number}"
            self.put(f"{type_of(node.kind)} {name};")
            self._value(node, name, names, maps)
            self._names[node.number] = name
            if home is not None:
                array, offset = home
                self._store(array, index_text(*linear(maps, node.shape), names, offset), name)
        for _ in names:
            self.close()
        self._names = {}

    def _finish(self, node: Node) -> None:
        """A result of one element goes to its place too."""
        home = self.plan.homes.get(node.number)
        if node.size == 1 and home is not None and node.number in self._scalars:
            self._store(home[0], str(home[1]), self._scalars[node.number])

    def _store(self, array: str, where: str, value: str) -> None:
        place = f"{array}[{where}]"
        self.put(f"{place} = {f'{place} + {value}' if array == SUMS else value};")

    def _copy(self, output: Output) -> None:
        names, maps = self.loop_over(output.node.shape)
        where = index_text(*linear(maps, output.node.shape), names, output.offset)
        self._store(output.place, where, self.read(output.node, names, maps))
        for _ in names:
            self.close()

    # -- values -------------------------------------------------------------------------------

    def _value(self, node: Node, name: str, names: Sequence[str], maps: Sequence[IndexMap]) -> None:
        """Compute one element of a node into a variable."""
        if node.op in POINTWISE:
            self.put(f"{name} = {self._expression(node, names, maps)};")
        else:
            write_reduction(self, node, name, names, maps)

    def _is_inline(self, node: Node) -> bool:
        return (
            node.op in POINTWISE
            and node.number not in self.plan.homes
            and node.number not in self._scalars
            and node.number not in self._names
        )

    def is_inline_product(self, node: Node) -> bool:
        return node.op == "mul" and self._is_inline(node)

    def _expression(self, node: Node, names: Sequence[str], maps: Sequence[IndexMap]) -> str:
        """A pointwise node's text; a product that is added to something takes an fma."""
        if node.op in ("add", "sub") and node.kind == "f":
            a, b = node.args
            if self.is_inline_product(a):
                left, right = (self.read(p, names, maps) for p in a.args)
                sign = "" if node.op == "add" else "-"
                return f"fma({left}, {right}, {sign}{self.read(b, names, maps)})"
            if self.is_inline_product(b):
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
            return literal(node.kind, node.attributes[0], self.real)
        if node.op == "iota":
            start, step = node.attributes
            (m,) = maps
            steps = tuple(step * s for s in m.steps)
            return f"isplat({index_text(start + step * m.offset, steps, names, 0)})"
        offset, steps = linear(maps, node.shape)
        if node.op == "input":
            return self._given(node, offset, steps, names)
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
                return self._given(source, offset, steps, names)
            node = source
        home = self.plan.homes.get(node.number)
        if home is not None:
            return f"{home[0]}[{index_text(offset, steps, names, home[1])}]"
        return self._expression(node, names, maps)

    def place(self, array: str, offset: int) -> tuple[str, int]:
        """Where what is given begins: an array of the caller, and where in it."""
        return array, offset

    def _given(self, node: Node, offset: int, steps: Sequence[int], names: Sequence[str]) -> str:
        array, base = self.place(*node.attributes)
        where = f"{array}[{index_text(offset, steps, names, base)}]"
        return f"splat({where})" if array in ALIKE else where

    def _table(self, node: Node) -> str:
        kind = self.real.name if node.kind == "f" else self.real.whole
        masks = {"True": "-1", "False": "0"}
        texts = node.attributes
        values = [
            number(t, self.real) if node.kind == "f" else whole(masks.get(t, t)) for t in texts
        ]
        key = (kind, *values)
        return self.tables.setdefault(key, f"t{len(self.tables)}")
