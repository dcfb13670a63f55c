"""Small systems of linear equations: LU with pivots, Cholesky, triangles."""

from __future__ import annotations

from typing import Any

from torch import Tensor

from ..graph.arithmetic import broadcast, pointwise, reduce
from ..graph.nodes import Graph, Node, Shape
from ..graph.reshapes import expand, narrow, permute, reshape
from .registry import as_kind, lowers
from .shapes import _diagonal


def _transposed(g: Graph, x: Node) -> Node:
    rank = len(x.shape)
    return permute(g, x, [*range(rank - 2), rank - 1, rank - 2])


def factors(g: Graph, A: Node) -> tuple[Node, Node]:
    """L and U in one matrix (..., n, n), and which row of A each row comes from (..., n)."""
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
    return solve(g, A, eye(g, A.shape), True, False)[0], g.full(0, A.shape[:-2], "i")


def _parity(g: Graph, lu: Node) -> Node:
    """1 where an even number of rows was exchanged, else -1."""
    one = g.full(1.0, lu.shape[:-2], "f")
    return g.node("lu_sign", (lu,), lu.shape[:-2], "f") if lu.size else one


@lowers("_linalg_det.default")
def _det(g: Graph, kind: str, A: Node, *, like: Tensor) -> tuple[Node, ...]:
    # Torch hands on the factors of the transpose, unless that would have to be copied.
    lu, rows = factors(g, _transposed(g, A) if like.is_contiguous() else A)
    diagonal = _diagonal(g, "f", lu, 0, -2, -1)
    size = reduce(g, "prod", diagonal, [len(diagonal.shape) - 1])
    return pointwise(g, "mul", [size, _parity(g, lu)], "f"), lu, rows


@lowers("_linalg_slogdet.default")
def _slogdet(g: Graph, kind: str, A: Node, *, like: Tensor) -> tuple[Node, ...]:
    lu, rows = factors(g, _transposed(g, A) if like.is_contiguous() else A)
    diagonal = _diagonal(g, "f", lu, 0, -2, -1)
    last = [len(diagonal.shape) - 1]
    signs = reduce(g, "prod", pointwise(g, "sign", [diagonal], "f"), last)
    sizes = pointwise(g, "log", [pointwise(g, "abs", [diagonal], "f")], "f")
    sign = pointwise(g, "mul", [signs, _parity(g, lu)], "f")
    return sign, reduce(g, "sum", sizes, last), lu, rows


@lowers("lu_unpack.default")
def _lu_unpack(
    g: Graph, kind: str, lu: Node, rows: Node, data: bool = True, pivots: bool = True
) -> tuple[Node, ...]:
    n, m = lu.shape[-2:]
    k = min(n, m)
    left, upper = narrow(g, lu, len(lu.shape) - 1, 0, k), narrow(g, lu, len(lu.shape) - 2, 0, k)
    lower = _triangle(g, kind, left, -1, op="ile")
    unit = pointwise(g, "add", [lower, eye(g, left.shape)], "f")
    column = reshape(g, g.iota(0, 1, n), (n, 1))
    from_row = pointwise(g, "ieq", [column, reshape(g, rows, (*rows.shape[:-1], 1, n))], "b")
    return as_kind(g, from_row, "f"), unit, _triangle(g, kind, upper)


@lowers("linalg_cholesky_ex.default")
def _cholesky(g: Graph, kind: str, A: Node, *, upper: bool = False, **_: Any) -> tuple[Node, ...]:
    found = g.node("cholesky", (_transposed(g, A) if upper else A,), A.shape, "f")
    return _transposed(g, found) if upper else found, g.full(0, A.shape[:-2], "i")


@lowers("linalg_solve_triangular.default")
def solve_triangular(
    g: Graph,
    kind: str,
    A: Node,
    B: Node,
    *,
    upper: bool,
    left: bool = True,
    unitriangular: bool = False,
) -> Node:
    """X with A X = B, or X A = B, for a triangle A."""
    if not left:
        parts = _transposed(g, A), _transposed(g, B)
        found = solve_triangular(g, kind, *parts, upper=not upper, unitriangular=unitriangular)
        return _transposed(g, found)
    lead = broadcast([A.shape[:-2], B.shape[:-2]])
    A, B = expand(g, A, (*lead, *A.shape[-2:])), expand(g, B, (*lead, *B.shape[-2:]))
    return g.node("triangular", (A, B), B.shape, "f", (upper, unitriangular))


@lowers("cholesky_solve.default")
def _cholesky_solve(g: Graph, kind: str, B: Node, L: Node, upper: bool = False) -> Node:
    lower, right = (_transposed(g, L), L) if upper else (L, _transposed(g, L))
    half = solve_triangular(g, kind, lower, B, upper=False)
    return solve_triangular(g, kind, right, half, upper=True)


@lowers("linalg_matrix_exp.default")
def _matrix_exp(g: Graph, kind: str, A: Node) -> Node:
    return g.node("matrix_exp", (A,), A.shape, "f")


@lowers("cholesky_inverse.default")
def _cholesky_inverse(g: Graph, kind: str, L: Node, upper: bool = False) -> Node:
    return _cholesky_solve(g, kind, eye(g, L.shape), L, upper)


@lowers("eye.default", "eye.m")
def _eye(g: Graph, kind: str, *_: Any, shape: Shape) -> Node:
    return as_kind(g, eye(g, shape), kind)


def eye(g: Graph, shape: Shape) -> Node:
    """Ones on the diagonal of the last two dimensions."""
    n, m = shape[-2:]
    same = pointwise(g, "ieq", [reshape(g, g.iota(0, 1, n), (n, 1)), g.iota(0, 1, m)], "b")
    return pointwise(g, "to_f", [same], "f", (), shape)


@lowers("triu.default")
def _triangle(g: Graph, kind: str, x: Node, diagonal: int = 0, *, op: str = "ige") -> Node:
    n, m = x.shape[-2:]
    row, column = reshape(g, g.iota(diagonal, 1, n), (n, 1)), g.iota(0, 1, m)
    return pointwise(
        g, "where", [pointwise(g, op, [column, row], "b"), x, g.full(0, (), x.kind)], x.kind
    )


@lowers("tril.default")
def _tril(g: Graph, kind: str, x: Node, diagonal: int = 0) -> Node:
    return _triangle(g, kind, x, diagonal, op="ile")
