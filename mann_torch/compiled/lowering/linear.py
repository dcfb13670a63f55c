"""Small systems of linear equations: LU with pivoting, the pivot chosen by compare-and-select."""

from __future__ import annotations

from typing import Any

from ..arithmetic import pointwise, reduce
from ..graph import Graph, Node
from ..views import permute, reshape
from .registry import lowers
from .shapes import _diagonal


def _transposed(g: Graph, x: Node) -> Node:
    rank = len(x.shape)
    return permute(g, x, [*range(rank - 2), rank - 1, rank - 2])


def factors(g: Graph, A: Node) -> tuple[Node, Node]:
    """L and U in one matrix (..., n, n), and the row of A that each row of it comes from (..., n)."""
    lu = g.node("lu", (A,), A.shape, "f")
    return lu, g.node("lu_rows", (lu,), A.shape[:-1], "i")


def solved(g: Graph, lu: Node, rows: Node, B: Node, adjoint: bool) -> Node:
    """A^-1 B, or with `adjoint` A'^-1 B, (..., n, k)."""
    return g.node("lu_solve", (lu, rows, B), B.shape, "f", (adjoint,))


def solve(g: Graph, A: Node, B: Node, left: bool, adjoint: bool) -> tuple[Node, Node, Node]:
    """X with A X = B, or X A = B where not `left`, and the factors of A."""
    lu, rows = factors(g, A)
    vector = len(B.shape) == len(A.shape) - 1
    column = reshape(g, B, (*B.shape, 1)) if vector else B
    if left:
        found = solved(g, lu, rows, column, adjoint)
    else:
        found = _transposed(g, solved(g, lu, rows, _transposed(g, column), not adjoint))
    return reshape(g, found, B.shape), lu, rows


@lowers("_linalg_solve_ex.default")
def _solve_ex(
    g: Graph, kind: str, A: Node, B: Node, *, left: bool = True, check_errors: bool = False
) -> tuple[Node, ...]:
    found, lu, rows = solve(g, A, B, left, False)
    return found, lu, rows, g.full(0, A.shape[:-2], "i")


@lowers("linalg_lu_factor_ex.default")
def _lu_factor(g: Graph, kind: str, A: Node, **_: Any) -> tuple[Node, ...]:
    return (*factors(g, A), g.full(0, A.shape[:-2], "i"))


@lowers("linalg_lu_solve.default")
def _lu_solve(
    g: Graph, kind: str, lu: Node, rows: Node, B: Node, *, left: bool = True, adjoint: bool = False
) -> Node:
    if left:
        return solved(g, lu, rows, B, adjoint)
    return _transposed(g, solved(g, lu, rows, _transposed(g, B), not adjoint))


@lowers("linalg_inv_ex.default")
def _inv(g: Graph, kind: str, A: Node, **_: Any) -> tuple[Node, ...]:
    n = A.shape[-1]
    same = pointwise(g, "ieq", [reshape(g, g.iota(0, 1, n), (n, 1)), g.iota(0, 1, n)], "b")
    eye = pointwise(g, "to_f", [same], "f", (), A.shape)
    return solve(g, A, eye, True, False)[0], g.full(0, A.shape[:-2], "i")


@lowers("_linalg_det.default")
def _det(g: Graph, kind: str, A: Node) -> tuple[Node, ...]:
    lu, rows = factors(g, A)
    diagonal = _diagonal(g, "f", lu, 0, -2, -1)
    sign = g.node("lu_sign", (lu,), A.shape[:-2], "f")
    size = reduce(g, "prod", diagonal, [len(diagonal.shape) - 1])
    return pointwise(g, "mul", [size, sign], "f"), lu, rows


@lowers("triu.default")
def _triangle(g: Graph, kind: str, x: Node, diagonal: int = 0, *, op: str = "ige") -> Node:
    n, m = x.shape[-2:]
    row, column = reshape(g, g.iota(diagonal, 1, n), (n, 1)), g.iota(0, 1, m)
    return pointwise(g, "where", [pointwise(g, op, [column, row], "b"), x, g.full(0, (), x.kind)], x.kind)


@lowers("tril.default")
def _tril(g: Graph, kind: str, x: Node, diagonal: int = 0) -> Node:
    return _triangle(g, kind, x, diagonal, op="ile")

