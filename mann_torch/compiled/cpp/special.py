"""C++ text of operations with loops of their own: pieces put together, elements chosen."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from ..graph.nodes import IndexMap, Node
from .expressions import TEXT, type_of
from .homes import at, choose, element, flat, home_of, rows_of
from .indices import index_text, linear
from .systems import cholesky, lu, lu_part, lu_solve, matrix_exp, triangular

if TYPE_CHECKING:
    from .writer import Writer


def _cat(w: Writer, node: Node) -> None:

    (dim,) = node.attributes
    home, start = home_of(w, node), 0
    for piece in node.args:
        names, maps = w.loop_over(piece.shape)
        placed = [*maps]
        placed[dim] = IndexMap(start, maps[dim].steps)
        where = index_text(*linear(placed, node.shape), names, home[1])
        w.put(f"{home[0]}[{where}] = {w.read(piece, names, maps)};")
        for _ in names:
            w.close()
        start += piece.shape[dim]


def _gather(w: Writer, node: Node) -> None:
    x, index = node.args
    lead, count = rows_of(node)
    home = home_of(w, node)
    names, maps = w.loop_over(lead)
    row = flat(lead, names, maps, count)
    w.open("j", count)
    w.put(f"M at = {element(w, index, names, maps, 'j')};")
    w.put(f"{type_of(node.kind)} got = {'splat(0.0)' if node.kind == 'f' else 'isplat(0)'};")
    w.open("c", x.shape[-1])
    here = element(w, x, names, maps, "c")
    w.put(f"got = {choose(node.kind)}(ieq(at, isplat(c)), {here}, got);")
    w.close()
    w.put(f"{at(home, f'{row} + j')} = got;")
    w.close()
    for _ in names:
        w.close()


def _scatter(w: Writer, node: Node) -> None:
    x, index, new = node.args
    lead, count = rows_of(node)
    home = home_of(w, node)
    names, maps = w.loop_over(lead)
    row = flat(lead, names, maps, count)
    w.open("c", count)
    w.put(f"{at(home, f'{row} + c')} = {element(w, x, names, maps, 'c')};")
    w.close()
    w.open("j", index.shape[-1])
    w.put(f"M at = {element(w, index, names, maps, 'j')};")
    w.put(f"{type_of(node.kind)} put = {element(w, new, names, maps, 'j')};")
    w.open("c", count)
    place = at(home, f"{row} + c")
    added = TEXT["add" if node.kind == "f" else "iadd"].format(place, "put")
    value = added if node.op == "scatter_add" else "put"
    w.put(f"{place} = {choose(node.kind)}(ieq(at, isplat(c)), {value}, {place});")
    w.close()
    w.close()
    for _ in names:
        w.close()


def _order(w: Writer, node: Node) -> None:
    """Each element's rank is how many come before it; the first of equals comes first."""
    (x,) = node.args
    (descending,) = node.attributes
    lead, count = rows_of(node)
    home = home_of(w, node)
    names, maps = w.loop_over(lead)
    row = flat(lead, names, maps, count)
    w.open("j", count)
    w.put(f"{at(home, f'{row} + j')} = isplat(0);")
    w.close()
    w.open("a", x.shape[-1])
    w.put(f"{type_of(x.kind)} mine = {element(w, x, names, maps, 'a')};")
    w.put("M rank = isplat(0);")
    w.open("c", x.shape[-1])
    w.put(f"{type_of(x.kind)} other = {element(w, x, names, maps, 'c')};")
    if x.kind == "f":
        nan = "(ne(other, other) & eq(mine, mine))", "(eq(other, other) & ne(mine, mine))"
        before = f"(gt(other, mine) | {nan[0]})" if descending else f"(lt(other, mine) | {nan[1]})"
        same = "(eq(other, mine) | (ne(other, other) & ne(mine, mine)))"
    else:
        before = "igt(other, mine)" if descending else "ilt(other, mine)"
        same = "ieq(other, mine)"
    w.put(f"rank = rank - ({before} | ({same} & isplat(c < a ? -1 : 0)));")
    w.close()
    w.open("j", count)
    place = at(home, f"{row} + j")
    w.put(f"{place} = isel(ieq(rank, isplat(j)), isplat(a), {place});")
    w.close()
    w.close()
    for _ in names:
        w.close()


def _scan(w: Writer, node: Node) -> None:
    (x,) = node.args
    lead, count = rows_of(node)
    home = home_of(w, node)
    names, maps = w.loop_over(lead)
    row = flat(lead, names, maps, count)
    start = 0 if node.op == "cumsum" else 1
    step = TEXT[("" if node.kind == "f" else "i") + ("mul" if start else "add")]
    w.put(f"{{ {type_of(node.kind)} run = {'splat' if node.kind == 'f' else 'isplat'}({start});")
    w.open("j", count)
    w.put(f"run = {step.format('run', element(w, x, names, maps, 'j'))};")
    w.put(f"{at(home, f'{row} + j')} = run;")
    w.close()
    w.put("}")
    for _ in names:
        w.close()


def _running(w: Writer, node: Node) -> None:
    """Where the extreme so far is: the last of equals, and of NaN."""
    (x,) = node.args
    lead, count = rows_of(node)
    home = home_of(w, node)
    names, maps = w.loop_over(lead)
    row = flat(lead, names, maps, count)
    zero = "isplat(0)"
    w.put(f"{{ {type_of(x.kind)} best = {element(w, x, names, maps, '0')}; M at = {zero};")
    w.open("j", count)
    w.put(f"{type_of(x.kind)} here = {element(w, x, names, maps, 'j')};")
    test = "ge" if node.op == "cummax" else "le"
    if x.kind == "f":
        w.put(f"M take = ({test}(here, best) | ne(here, here));")
    else:
        w.put(f"M take = i{test}(here, best);")
    w.put(f"best = {choose(x.kind)}(take, here, best); at = isel(take, isplat(j), at);")
    w.put(f"{at(home, f'{row} + j')} = at;")
    w.close()
    w.put("}")
    for _ in names:
        w.close()


#: Operation -> what writes it.
SPECIAL: dict[str, Callable[[Any, Node], None]] = {
    "cat": _cat,
    "gather": _gather,
    "scatter": _scatter,
    "scatter_add": _scatter,
    "order": _order,
    "cumsum": _scan,
    "cumprod": _scan,
    "lu": lu,
    "lu_rows": lu_part,
    "lu_sign": lu_part,
    "lu_solve": lu_solve,
    "cholesky": cholesky,
    "triangular": triangular,
    "matrix_exp": matrix_exp,
    "cummax": _running,
    "cummin": _running,
}
