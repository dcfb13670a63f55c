"""Operations on each element by itself."""

from __future__ import annotations

import math
from typing import Any

from ..graph.arithmetic import pointwise
from ..graph.nodes import Graph, Node
from .registry import as_kind, common_kind, lowers

Found = Node
_NAMES = """
    abs sqrt exp exp2 expm1 log log2 log10 log1p sin cos tan asin acos atan sinh cosh tanh asinh
    acosh atanh sigmoid erf erfc reciprocal floor ceil trunc round neg
"""
_OF_INTEGERS = {"add": "iadd", "sub": "isub", "mul": "imul", "neg": "ineg", "abs": "iabs"}
_KEEP_INTEGERS = ("floor", "ceil", "trunc", "round")


def _unary(op: str) -> None:
    @lowers(f"{op}.default")
    def lower(g: Graph, kind: str, x: Node) -> Found:
        if kind == "i" and op in _KEEP_INTEGERS:
            return x
        name = _OF_INTEGERS.get(op, op) if kind == "i" else op
        return pointwise(g, name, [as_kind(g, x, kind)], kind)


for _op in _NAMES.split():
    _unary(_op)


@lowers("sign.default")
def _sign(g: Graph, kind: str, x: Node) -> Found:
    if kind == "f":
        return pointwise(g, "sign", [x], "f")
    least = pointwise(g, "imax", [as_kind(g, x, "i"), g.full(-1, (), "i")], "i")
    return as_kind(g, pointwise(g, "imin", [least, g.full(1, (), "i")], "i"), kind)


@lowers("rsqrt.default")
def _rsqrt(g: Graph, kind: str, x: Node) -> Found:
    return pointwise(g, "reciprocal", [pointwise(g, "sqrt", [x], "f")], "f")


def _binary(op: str, *names: str) -> None:
    @lowers(*(f"{name}.{form}" for name in names for form in ("Tensor", "Scalar", "default")))
    def lower(g: Graph, kind: str, a: Any, b: Any, *, alpha: Any = 1) -> Found:
        left, right = as_kind(g, a, kind), as_kind(g, b, kind)
        name = _OF_INTEGERS.get(op, op) if kind != "f" else op
        if kind == "b":
            name = {"add": "or", "mul": "and"}.get(op, op)
        if alpha != 1:
            times = "mul" if kind == "f" else "imul"
            right = pointwise(g, times, [right, g.full(alpha, (), kind)], kind)
        return pointwise(g, name, [left, right], kind)


for _op in ("add", "sub", "mul"):
    _binary(_op, _op)


@lowers("div.Tensor", "div.Scalar", "true_divide.Tensor")
def _div(g: Graph, kind: str, a: Any, b: Any) -> Found:
    return pointwise(g, "div", [as_kind(g, a, "f"), as_kind(g, b, "f")], "f")


@lowers("atan2.default")
def _of_two(g: Graph, kind: str, a: Any, b: Any, *, op: str = "atan2") -> Found:
    return pointwise(g, op, [as_kind(g, a, "f"), as_kind(g, b, "f")], "f")


@lowers("copysign.Tensor", "copysign.Scalar")
def _copysign(g: Graph, kind: str, a: Any, b: Any) -> Found:
    return _of_two(g, kind, a, b, op="copysign")


@lowers("hypot.default")
def _hypot(g: Graph, kind: str, a: Any, b: Any) -> Found:
    return _of_two(g, kind, a, b, op="hypot")


def extreme(g: Graph, op: str, kind: str, a: Any, b: Any) -> Found:
    """max or min of two."""
    if kind == "b":
        return pointwise(g, "or" if op == "max" else "and", [a, b], "b")
    return pointwise(
        g, op if kind == "f" else f"i{op}", [as_kind(g, a, kind), as_kind(g, b, kind)], kind
    )


@lowers("maximum.default", "clamp_min.default", "clamp_min.Tensor", "relu.default")
def _maximum(g: Graph, kind: str, a: Any, b: Any = 0) -> Found:
    return extreme(g, "max", kind, a, b)


@lowers("minimum.default", "clamp_max.default", "clamp_max.Tensor")
def _minimum(g: Graph, kind: str, a: Any, b: Any) -> Found:
    return extreme(g, "min", kind, a, b)


@lowers("fmax.default")
def _fmax(g: Graph, kind: str, a: Any, b: Any, *, op: str = "max") -> Found:
    """The larger; the other where one is NaN."""
    found = extreme(g, op, kind, a, b)
    for x, other in ((a, b), (b, a)):
        found = pointwise(g, "where", [isnan(g, "b", x), as_kind(g, other, kind), found], kind)
    return found


@lowers("fmin.default")
def _fmin(g: Graph, kind: str, a: Any, b: Any) -> Found:
    return _fmax(g, kind, a, b, op="min")


@lowers("clamp.default", "clamp.Tensor", "hardtanh.default")
def _clamp(g: Graph, kind: str, x: Node, min: Any = None, max: Any = None) -> Found:
    found = as_kind(g, x, kind)
    if min is not None:
        found = extreme(g, "max", kind, found, min)
    return found if max is None else extreme(g, "min", kind, found, max)


@lowers("pow.Tensor_Scalar")
def _power(g: Graph, kind: str, x: Node, exponent: float) -> Found:
    """Small whole exponents are products, as in torch."""
    if kind == "i":
        found = x
        if not (isinstance(exponent, int) and exponent >= 1):
            return as_kind(g, _power(g, "f", as_kind(g, x, "f"), exponent), "i")
        for _ in range(exponent - 1):
            found = pointwise(g, "imul", [found, x], "i")
        return found
    x = as_kind(g, x, "f")
    if exponent == 0:
        return g.full(1.0, x.shape, "f")
    simple = {0.5: "sqrt", -1.0: "reciprocal", 2.0: "square"}.get(float(exponent))
    if exponent == 1:
        return x
    if simple == "square":
        return pointwise(g, "mul", [x, x], "f")
    if simple is not None:
        return pointwise(g, simple, [x], "f")
    if exponent == -0.5:
        return pointwise(g, "reciprocal", [pointwise(g, "sqrt", [x], "f")], "f")
    if exponent == 3:
        return pointwise(g, "mul", [pointwise(g, "mul", [x, x], "f"), x], "f")
    return pointwise(g, "pow", [x, g.full(exponent, (), "f")], "f")


@lowers("pow.Tensor_Tensor", "pow.Scalar")
def _pow(g: Graph, kind: str, a: Any, b: Any) -> Found:
    found = pointwise(g, "pow", [as_kind(g, a, "f"), as_kind(g, b, "f")], "f")
    return as_kind(g, found if kind == "f" else pointwise(g, "round", [found], "f"), kind)


def _comparison(op: str) -> None:
    @lowers(f"{op}.Tensor", f"{op}.Scalar")
    def lower(g: Graph, kind: str, a: Any, b: Any) -> Found:
        inner = common_kind(a, b)
        if inner == "b":
            inner = "i"
        name = op if inner == "f" else f"i{op}"
        return pointwise(g, name, [as_kind(g, a, inner), as_kind(g, b, inner)], "b")


for _op in ("lt", "le", "gt", "ge", "eq", "ne"):
    _comparison(_op)


def _logical(op: str, *names: str) -> None:
    @lowers(*names)
    def lower(g: Graph, kind: str, *operands: Any) -> Found:
        inner = "b" if kind == "b" else "i"
        return pointwise(g, op, [as_kind(g, a, inner) for a in operands], kind)


for _op in ("and", "or", "xor", "not"):
    _forms = [f"bitwise_{_op}.{form}" for form in ("Tensor", "Scalar", "default")]
    _logical(_op, f"logical_{_op}.default", *_forms)


@lowers("where.self", "where.ScalarSelf", "where.ScalarOther", "where.Scalar")
def _where(g: Graph, kind: str, condition: Node, a: Any, b: Any) -> Found:
    parts = [as_kind(g, condition, "b"), as_kind(g, a, kind), as_kind(g, b, kind)]
    return pointwise(g, "where", parts, kind)


@lowers(
    "_to_copy.default",
    "clone.default",
    "alias.default",
    "detach.default",
    "to.dtype",
    "lift_fresh_copy.default",
    "lift_fresh.default",
    "contiguous.default",
    "prims.convert_element_type.default",
    "prims.copy_strided.default",
    "convert_element_type.default",
)
def _copy(g: Graph, kind: str, x: Node, *_: Any, **__: Any) -> Found:
    return as_kind(g, x, kind)


@lowers("isnan.default")
def isnan(g: Graph, kind: str, x: Node) -> Found:
    """Where there is no number."""
    return pointwise(g, "ne", [x, x], "b") if x.kind == "f" else g.full(False, x.shape, "b")


@lowers("isinf.default")
def _isinf(g: Graph, kind: str, x: Node) -> Found:
    size = pointwise(g, "abs", [as_kind(g, x, "f")], "f")
    return pointwise(g, "eq", [size, g.full(math.inf, (), "f")], "b")
