"""Operations with loops of their own: pieces put together, elements chosen at run time, LU."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from ..graph import IndexMap, Node

if TYPE_CHECKING:
    from .writer import Writer


def _type(kind: str) -> str:
    return "V" if kind == "f" else "M"


def _choose(kind: str) -> str:
    return "sel" if kind == "f" else "isel"


def _home(w: Writer, node: Node) -> tuple[str, int]:
    """Where a node's elements are; of one element, in an array of its own for now."""
    home = w.plan.homes.get(node.number)
    if home is None:
        name = f"s{node.number}"
        w.put(f"{_type(node.kind)} {name}[1];")
        home = w.plan.homes[node.number] = (name, 0)
    return home


def _at(home: tuple[str, int], index: str) -> str:
    return f"{home[0]}[{home[1]} + {index}]" if home[1] else f"{home[0]}[{index}]"


def _cat(w: Writer, node: Node) -> None:
    from .writer import index_text, linear

    (dim,) = node.attributes
    home, start = _home(w, node), 0
    for piece in node.args:
        names, maps = w.loop_over(piece.shape)
        placed = [*maps]
        placed[dim] = IndexMap(start, maps[dim].steps)
        where = index_text(*linear(placed, node.shape), names, home[1])
        w.put(f"{home[0]}[{where}] = {w.read(piece, names, maps)};")
        for _ in names:
            w.close()
        start += piece.shape[dim]


def _rows(node: Node) -> tuple[tuple[int, ...], int]:
    return node.shape[:-1], node.shape[-1]


def _flat(shape: tuple[int, ...], names: list[str], maps: list[IndexMap], width: int) -> str:
    """Linear index of the first element of a row of `width`."""
    from .writer import index_text, linear

    if not shape:
        return "0"
    offset, steps = linear(maps, shape)
    return f"({index_text(offset, steps, names, 0)}) * {width}"


def _element(w: Writer, x: Node, names: list[str], maps: list[IndexMap], *last: str) -> str:
    """An element of x: leading indices as given, then loop variables."""
    count = len(last)
    outer = [IndexMap(m.offset, m.steps + (0,) * count) for m in maps]
    inner = [
        IndexMap(0, (0,) * len(names) + tuple(int(k == j) for j in range(count)))
        for k in range(count)
    ]
    return w.read(x, [*names, *last], outer + inner)


def _gather(w: Writer, node: Node) -> None:
    x, index = node.args
    lead, count = _rows(node)
    home = _home(w, node)
    names, maps = w.loop_over(lead)
    row = _flat(lead, names, maps, count)
    w.open("j", count)
    w.put(f"M at = {_element(w, index, names, maps, 'j')};")
    w.put(f"{_type(node.kind)} got = {'splat(0.0)' if node.kind == 'f' else 'isplat(0)'};")
    w.open("c", x.shape[-1])
    here = _element(w, x, names, maps, "c")
    w.put(f"got = {_choose(node.kind)}(ieq(at, isplat(c)), {here}, got);")
    w.close()
    w.put(f"{_at(home, f'{row} + j')} = got;")
    w.close()
    for _ in names:
        w.close()


def _scatter(w: Writer, node: Node) -> None:
    x, index, new = node.args
    lead, count = _rows(node)
    home = _home(w, node)
    names, maps = w.loop_over(lead)
    row = _flat(lead, names, maps, count)
    w.open("c", count)
    w.put(f"{_at(home, f'{row} + c')} = {_element(w, x, names, maps, 'c')};")
    w.close()
    w.open("j", index.shape[-1])
    w.put(f"M at = {_element(w, index, names, maps, 'j')};")
    w.put(f"{_type(node.kind)} put = {_element(w, new, names, maps, 'j')};")
    w.open("c", count)
    place = _at(home, f"{row} + c")
    value = f"{place} + put" if node.op == "scatter_add" else "put"
    w.put(f"{place} = {_choose(node.kind)}(ieq(at, isplat(c)), {value}, {place});")
    w.close()
    w.close()
    for _ in names:
        w.close()


def _order(w: Writer, node: Node) -> None:
    """Each element's rank is how many come before it; the first of equals comes first."""
    (x,) = node.args
    (descending,) = node.attributes
    lead, count = _rows(node)
    home = _home(w, node)
    names, maps = w.loop_over(lead)
    row = _flat(lead, names, maps, count)
    w.open("j", count)
    w.put(f"{_at(home, f'{row} + j')} = isplat(0);")
    w.close()
    w.open("a", x.shape[-1])
    w.put(f"{_type(x.kind)} mine = {_element(w, x, names, maps, 'a')};")
    w.put("M rank = isplat(0);")
    w.open("c", x.shape[-1])
    w.put(f"{_type(x.kind)} other = {_element(w, x, names, maps, 'c')};")
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
    place = _at(home, f"{row} + j")
    w.put(f"{place} = isel(ieq(rank, isplat(j)), isplat(a), {place});")
    w.close()
    w.close()
    for _ in names:
        w.close()


def _scan(w: Writer, node: Node) -> None:
    (x,) = node.args
    lead, count = _rows(node)
    home = _home(w, node)
    names, maps = w.loop_over(lead)
    row = _flat(lead, names, maps, count)
    sign, start = ("+", 0) if node.op == "cumsum" else ("*", 1)
    w.put(f"{{ {_type(node.kind)} run = {'splat' if node.kind == 'f' else 'isplat'}({start});")
    w.open("j", count)
    w.put(f"run = run {sign} {_element(w, x, names, maps, 'j')};")
    w.put(f"{_at(home, f'{row} + j')} = run;")
    w.close()
    w.put("}")
    for _ in names:
        w.close()


def _lu(w: Writer, node: Node) -> None:
    """Factors in place; the rows' numbers and the permutation's sign come with them."""
    (A,) = node.args
    lead, n = node.shape[:-2], node.shape[-1]
    total = node.size // (n * n) if n else 0
    home = _home(w, node)
    w.put(f"M rows{node.number}[{max(total * n, 1)}]; V sign{node.number}[{max(total, 1)}];")
    names, maps = w.loop_over(node.shape)
    from .writer import index_text, linear

    where = index_text(*linear(maps, node.shape), names, home[1])
    w.put(f"{home[0]}[{where}] = {w.read(A, names, maps)};")
    for _ in names:
        w.close()
    names, maps = w.loop_over(lead)
    which = _flat(lead, names, maps, 1)
    w.put(
        f"lu_factor(&{_at(home, f'({which}) * {n * n}')}, rows{node.number} + ({which}) * {n}, "
        f"sign{node.number} + ({which}), {n});"
    )
    for _ in names:
        w.close()


def _lu_part(w: Writer, node: Node) -> None:
    (lu,) = node.args
    home = _home(w, node)
    source = f"{'rows' if node.op == 'lu_rows' else 'sign'}{lu.number}"
    w.open("j", node.size)
    w.put(f"{_at(home, 'j')} = {source}[j];")
    w.close()


def _lu_solve(w: Writer, node: Node) -> None:
    lu, rows, B = node.args
    (adjoint,) = node.attributes
    n, k = node.shape[-2:]
    lead = node.shape[:-2]
    home, factors, order = _home(w, node), w.plan.homes[lu.number], w.plan.homes[rows.number]
    names, maps = w.loop_over(node.shape)
    from .writer import index_text, linear

    where = index_text(*linear(maps, node.shape), names, home[1])
    w.put(f"{home[0]}[{where}] = {w.read(B, names, maps)};")
    for _ in names:
        w.close()
    names, maps = w.loop_over(lead)
    which = _flat(lead, names, maps, 1)
    w.put(f"{{ V room[{n * k}];")
    w.put(
        f"lu_{'adjoint_' if adjoint else ''}solve(&{_at(factors, f'({which}) * {n * n}')}, "
        f"&{_at(order, f'({which}) * {n}')}, &{_at(home, f'({which}) * {n * k}')}, room, {n}, {k}); }}"
    )
    for _ in names:
        w.close()


def _cholesky(w: Writer, node: Node) -> None:
    """Row by row, each from the rows above; of the matrix only the lower triangle is read."""
    (A,) = node.args
    n = node.shape[-1]
    home = _home(w, node)
    names, maps = w.loop_over(node.shape[:-2])
    row = _flat(node.shape[:-2], names, maps, n * n)
    w.put(f"{{ {_type('f')}* const L = &{_at(home, row)};")
    w.put(f"for (int i = 0; i < {n}; ++i) for (int j = 0; j < {n}; ++j) {{")
    w.put(f"if (j > i) {{ L[i * {n} + j] = splat(0.0); continue; }}")
    w.put(f"V s = {_element(w, A, names, maps, 'i', 'j')};")
    w.put(f"for (int k = 0; k < j; ++k) s = fma(-L[i * {n} + k], L[j * {n} + k], s);")
    w.put(f"L[i * {n} + j] = j == i ? sqrt_(s) : s / L[j * {n} + j];")
    w.put("} }")
    for _ in names:
        w.close()


def _triangular(w: Writer, node: Node) -> None:
    """Substitution, from the first row on or from the last."""
    A, B = node.args
    upper, unit = node.attributes
    n, k = node.shape[-2:]
    home = _home(w, node)
    names, maps = w.loop_over(node.shape[:-2])
    row = _flat(node.shape[:-2], names, maps, n * k)
    w.put(f"{{ V* const X = &{_at(home, row)};")
    w.put(f"for (int t = 0; t < {n}; ++t) for (int c = 0; c < {k}; ++c) {{")
    w.put(f"const int i = {f'{n - 1} - t' if upper else 't'};")
    w.put(f"V s = {_element(w, B, names, maps, 'i', 'c')};")
    w.put(f"for (int j = {f'i + 1; j < {n}' if upper else '0; j < i'}; ++j)")
    w.put(f"  s = fma(-{_element(w, A, names, maps, 'i', 'j')}, X[j * {k} + c], s);")
    w.put(f"X[i * {k} + c] = {'s' if unit else 's / ' + _element(w, A, names, maps, 'i', 'i')};")
    w.put("} }")
    for _ in names:
        w.close()


def _running(w: Writer, node: Node) -> None:
    """Where the extreme so far is: the last of equals, the first NaN."""
    (x,) = node.args
    lead, count = _rows(node)
    home = _home(w, node)
    names, maps = w.loop_over(lead)
    row = _flat(lead, names, maps, count)
    zero = "isplat(0)"
    w.put(f"{{ {_type(x.kind)} best = {_element(w, x, names, maps, '0')}; M at = {zero};")
    w.open("j", count)
    w.put(f"{_type(x.kind)} here = {_element(w, x, names, maps, 'j')};")
    test = "ge" if node.op == "cummax" else "le"
    if x.kind == "f":
        w.put(f"M take = ({test}(here, best) | (ne(here, here) & eq(best, best)));")
    else:
        w.put(f"M take = i{test}(here, best);")
    w.put(f"best = {_choose(x.kind)}(take, here, best); at = isel(take, isplat(j), at);")
    w.put(f"{_at(home, f'{row} + j')} = at;")
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
    "lu": _lu,
    "lu_rows": _lu_part,
    "lu_sign": _lu_part,
    "lu_solve": _lu_solve,
    "cholesky": _cholesky,
    "triangular": _triangular,
    "cummax": _running,
    "cummin": _running,
}
