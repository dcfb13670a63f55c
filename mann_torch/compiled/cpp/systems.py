"""C++ text of small systems of equations: calls of the lanes' factorisations."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ..graph.nodes import Node
from .expressions import type_of
from .homes import at, element, flat, home_of
from .indices import index_text, linear

if TYPE_CHECKING:
    from .writer import Writer

#: Terms of the exponential series of a matrix of norm 1/2: the next would be 2^-17 / 16! < 1e-18.
_TAYLOR = 16


def lu(w: Writer, node: Node) -> None:
    """Factors in place; the rows' numbers and the permutation's sign come with them."""
    (A,) = node.args
    lead, n = node.shape[:-2], node.shape[-1]
    total = node.size // (n * n) if n else 0
    home = home_of(w, node)
    w.plan.arrays[f"rows{node.number}"] = (max(total * n, 1), "i")
    w.plan.arrays[f"sign{node.number}"] = (max(total, 1), "f")
    names, maps = w.loop_over(node.shape)

    where = index_text(*linear(maps, node.shape), names, home[1])
    w.put(f"{home[0]}[{where}] = {w.read(A, names, maps)};")
    for _ in names:
        w.close()
    names, maps = w.loop_over(lead)
    which = flat(lead, names, maps, 1)
    w.put(
        f"lu_factor(&{at(home, f'({which}) * {n * n}')}, rows{node.number} + ({which}) * {n}, "
        f"sign{node.number} + ({which}), {n});"
    )
    for _ in names:
        w.close()


def lu_part(w: Writer, node: Node) -> None:
    (lu,) = node.args
    home = home_of(w, node)
    source = f"{'rows' if node.op == 'lu_rows' else 'sign'}{lu.number}"
    w.open("j", node.size)
    w.put(f"{at(home, 'j')} = {source}[j];")
    w.close()


def lu_solve(w: Writer, node: Node) -> None:
    lu, rows, B = node.args
    (adjoint,) = node.attributes
    n, k = node.shape[-2:]
    lead = node.shape[:-2]
    home, factors, order = home_of(w, node), w.plan.homes[lu.number], w.plan.homes[rows.number]
    names, maps = w.loop_over(node.shape)

    where = index_text(*linear(maps, node.shape), names, home[1])
    w.put(f"{home[0]}[{where}] = {w.read(B, names, maps)};")
    for _ in names:
        w.close()
    names, maps = w.loop_over(lead)
    which = flat(lead, names, maps, 1)
    w.plan.arrays[f"room{node.number}"] = (n * k, "f")
    w.put(
        f"lu_{'adjoint_' if adjoint else ''}solve(&{at(factors, f'({which}) * {n * n}')}, "
        f"&{at(order, f'({which}) * {n}')}, &{at(home, f'({which}) * {n * k}')}, "
        f"room{node.number}, {n}, {k});"
    )
    for _ in names:
        w.close()


def cholesky(w: Writer, node: Node) -> None:
    """Row by row, each from the rows above; of the matrix only the lower triangle is read."""
    (A,) = node.args
    n = node.shape[-1]
    home = home_of(w, node)
    names, maps = w.loop_over(node.shape[:-2])
    row = flat(node.shape[:-2], names, maps, n * n)
    w.put(f"{{ {type_of('f')}* const L = &{at(home, row)};")
    w.put(f"for (int i = 0; i < {n}; ++i) for (int j = 0; j < {n}; ++j) {{")
    w.put(f"if (j > i) {{ L[i * {n} + j] = splat(0.0); continue; }}")
    w.put(f"V s = {element(w, A, names, maps, 'i', 'j')};")
    w.put(f"for (int k = 0; k < j; ++k) s = fma(-L[i * {n} + k], L[j * {n} + k], s);")
    w.put(f"L[i * {n} + j] = j == i ? sqrt_(s) : s / L[j * {n} + j];")
    w.put("} }")
    for _ in names:
        w.close()


def triangular(w: Writer, node: Node) -> None:
    """Substitution, from the first row on or from the last."""
    A, B = node.args
    upper, unit = node.attributes
    n, k = node.shape[-2:]
    home = home_of(w, node)
    names, maps = w.loop_over(node.shape[:-2])
    row = flat(node.shape[:-2], names, maps, n * k)
    w.put(f"{{ V* const X = &{at(home, row)};")
    w.put(f"for (int t = 0; t < {n}; ++t) for (int c = 0; c < {k}; ++c) {{")
    w.put(f"const int i = {f'{n - 1} - t' if upper else 't'};")
    w.put(f"V s = {element(w, B, names, maps, 'i', 'c')};")
    w.put(f"for (int j = {f'i + 1; j < {n}' if upper else '0; j < i'}; ++j)")
    w.put(f"  s = fma(-{element(w, A, names, maps, 'i', 'j')}, X[j * {k} + c], s);")
    w.put(f"X[i * {k} + c] = {'s' if unit else 's / ' + element(w, A, names, maps, 'i', 'i')};")
    w.put("} }")
    for _ in names:
        w.close()


def matrix_exp(w: Writer, node: Node) -> None:
    """Halved until its norm is below 1/2, summed as Taylor's series, squared again."""
    (A,) = node.args
    n = node.shape[-1]
    home = home_of(w, node)
    small, power = f"small{node.number}", f"power{node.number}"
    w.plan.arrays |= dict.fromkeys((small, power), (n * n, "f"))
    names, maps = w.loop_over(node.shape[:-2])
    row = flat(node.shape[:-2], names, maps, n * n)
    every = f"for (int e = 0; e < {n * n}; ++e)"
    product = (
        f"for (int i = 0; i < {n}; ++i) for (int j = 0; j < {n}; ++j) {{ V s = splat(0.0); "
        f"for (int k = 0; k < {n}; ++k) s = fma(@[i * {n} + k], X[k * {n} + j], s); "
        f"{power}[i * {n} + j] = s; }}"
    )
    w.put(f"{{ V* const X = &{at(home, row)}; V norm = splat(0.0);")
    w.put(f"for (int j = 0; j < {n}; ++j) {{ V s = splat(0.0);")
    w.put(f"for (int i = 0; i < {n}; ++i) {{ V a = {element(w, A, names, maps, 'i', 'j')};")
    w.put(f"{small}[i * {n} + j] = a; s = s + abs_(a); }} norm = max_(norm, s); }}")
    w.put("const V most = splat(1100.0), none = splat(0.0);")
    w.put("const V halvings = max_(none, min_(most, ceil_(log2_(norm)) + splat(1.0)));")
    w.put(f"{every} {{ {small}[e] = {small}[e] * exp2_(-halvings); X[e] = none; }}")
    w.put(f"for (int i = 0; i < {n}; ++i) X[i * {n} + i] = splat(1.0);")
    w.put(f"for (int order = {_TAYLOR}; order > 0; --order) {{")
    w.put(product.replace("@", small))
    w.put(f"{every} X[e] = {power}[e] / splat(order) + splat(e % {n + 1} == 0 ? 1.0 : 0.0); }}")
    w.put("for (int t = 0; any(lt(splat(t), halvings)); ++t) {")
    w.put(product.replace("@", "X"))
    w.put(f"const M more = lt(splat(t), halvings); {every} X[e] = sel(more, {power}[e], X[e]);")
    w.put("} }")
    for _ in names:
        w.close()
