"""Operations on each element by itself."""

from __future__ import annotations

import math
from typing import Any

import torch

from ..arithmetic import pointwise
from ..graph import Graph, Node
from .registry import as_kind, common_kind, kind_of, lowers

Found = Node
_UNARY = (
    "abs sqrt exp exp2 expm1 log log2 log10 log1p sin cos tan asin acos atan sinh cosh tanh asinh "
    "acosh atanh sigmoid erf erfc reciprocal floor ceil trunc round"
).split()
_OF_INTEGERS = {"add": "iadd", "sub": "isub", "mul": "imul", "neg": "ineg", "abs": "iabs"}
_KEEP_INTEGERS = ("floor", "ceil", "trunc", "round")


def _unary(op: str) -> None:
    @lowers(f"{op}.default")
    def lower(g: Graph, kind: str, x: Node) -> Found:
        if kind == "i" and op in _KEEP_INTEGERS:
            return x
        name = _OF_INTEGERS.get(op, op) if kind == "i" else op
        return pointwise(g, name, [as_kind(g, x, kind)], kind)


for _op in (*_UNARY, "neg", "sign"):
    _unary(_op)


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


@lowers("div.Tensor_mode", "div.Scalar_mode")
def _div_mode(g: Graph, kind: str, a: Any, b: Any, *, rounding_mode: str | None = None) -> Found:
    if kind == "i" and rounding_mode == "floor":
        return pointwise(g, "idiv", [as_kind(g, a, "i"), as_kind(g, b, "i")], "i")
    whole = _div(g, "f", a, b)
    if rounding_mode is not None:
        whole = pointwise(g, rounding_mode, [whole], "f")
    return as_kind(g, whole, kind)


@lowers("floor_divide.default")
def _floor_divide(g: Graph, kind: str, a: Any, b: Any) -> Found:
    return _div_mode(g, kind, a, b, rounding_mode="floor")


@lowers("remainder.Tensor", "remainder.Scalar")
def _remainder(g: Graph, kind: str, a: Any, b: Any, *, op: str = "remainder") -> Found:
    name = "imod" if kind == "i" and op == "remainder" else op
    return pointwise(g, name, [as_kind(g, a, kind), as_kind(g, b, kind)], kind)


@lowers("fmod.Tensor", "fmod.Scalar")
def _fmod(g: Graph, kind: str, a: Any, b: Any) -> Found:
    found = _remainder(g, "f", a, b, op="fmod")
    return as_kind(g, found, kind)


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
    return pointwise(g, op if kind == "f" else f"i{op}", [as_kind(g, a, kind), as_kind(g, b, kind)], kind)


@lowers("maximum.default", "clamp_min.default", "clamp_min.Tensor", "relu.default")
def _maximum(g: Graph, kind: str, a: Any, b: Any = 0) -> Found:
    return extreme(g, "max", kind, a, b)


@lowers("minimum.default", "clamp_max.default", "clamp_max.Tensor")
def _minimum(g: Graph, kind: str, a: Any, b: Any) -> Found:
    return extreme(g, "min", kind, a, b)


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
    return as_kind(g, pointwise(g, "pow", [as_kind(g, a, "f"), as_kind(g, b, "f")], "f"), kind)


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


@lowers("_to_copy.default", "clone.default", "alias.default", "detach.default", "to.dtype",
        "lift_fresh_copy.default", "lift_fresh.default", "contiguous.default",
        "prims.convert_element_type.default", "convert_element_type.default")
def _copy(g: Graph, kind: str, x: Node, *_: Any, **__: Any) -> Found:
    return as_kind(g, x, kind)


@lowers("isnan.default")
def _isnan(g: Graph, kind: str, x: Node) -> Found:
    return pointwise(g, "ne", [x, x], "b") if x.kind == "f" else g.full(False, x.shape, "b")


@lowers("isinf.default")
def _isinf(g: Graph, kind: str, x: Node) -> Found:
    size = pointwise(g, "abs", [as_kind(g, x, "f")], "f")
    return pointwise(g, "eq", [size, g.full(math.inf, (), "f")], "b")


@lowers("full.default")
def _full(g: Graph, kind: str, size: Any, value: Any, *, shape: tuple[int, ...]) -> Found:
    return g.full(value, shape, kind)


@lowers("scalar_tensor.default")
def _scalar(g: Graph, kind: str, value: Any) -> Found:
    return g.full(value, (), kind)


@lowers("zeros.default", "zeros_like.default", "empty.memory_format", "empty_like.default")
def _zeros(g: Graph, kind: str, *_: Any, shape: tuple[int, ...]) -> Found:
    return g.full(0, shape, kind)


@lowers("ones.default", "ones_like.default")
def _ones(g: Graph, kind: str, *_: Any, shape: tuple[int, ...]) -> Found:
    return g.full(1, shape, kind)


@lowers("full_like.default")
def _full_like(g: Graph, kind: str, x: Node, value: Any) -> Found:
    return g.full(value, x.shape, kind)


@lowers("fill.Scalar", "fill.Tensor")
def _fill(g: Graph, kind: str, x: Node, value: Any) -> Found:
    return pointwise(g, f"to_{kind}", [as_kind(g, value, kind)], kind, (), x.shape)


@lowers("arange.start_step")
def _arange(g: Graph, kind: str, start: Any, end: Any, step: Any = 1, **_: Any) -> Found:
    if any(isinstance(x, float) for x in (start, end, step)):
        count = max(0, math.ceil((end - start) / step))
        return g.table([start + i * step for i in range(count)], (count,), "f")
    count = max(0, -(-(end - start) // step))
    return as_kind(g, g.iota(start, step, count), kind)


def dtype_kind(value: Any) -> str:
    """The kind of what a traced operation gives."""
    tensor = value if isinstance(value, torch.Tensor) else value[0]
    return kind_of(tensor.dtype)
