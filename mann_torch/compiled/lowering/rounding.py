"""Divisions with a rounded quotient, remainders, and rounding to decimals."""

from __future__ import annotations

from typing import Any

from ..graph.arithmetic import pointwise
from ..graph.nodes import Graph, Node
from .registry import as_kind, lowers


def _both(g: Graph, kind: str, a: Any, b: Any) -> tuple[Node, Node]:
    return as_kind(g, a, kind), as_kind(g, b, kind)


@lowers("div.Tensor_mode", "div.Scalar_mode")
def _div_mode(g: Graph, kind: str, a: Any, b: Any, *, rounding_mode: str | None = None) -> Node:
    if rounding_mode == "floor":
        return _floor_divide(g, kind, a, b)
    left, right = _both(g, kind, a, b)
    if kind == "i" and rounding_mode == "trunc":
        whole = pointwise(g, "isub", [left, _fmod(g, "i", left, right)], "i")
        return pointwise(g, "idiv", [whole, right], "i")
    quotient = pointwise(g, "div", [left, right], "f")
    return quotient if rounding_mode is None else pointwise(g, rounding_mode, [quotient], "f")


@lowers("floor_divide.default", "floor_divide.Scalar")
def _floor_divide(g: Graph, kind: str, a: Any, b: Any) -> Node:
    """As Python and torch have it: 1 // 0.1 is 9, for 0.1 is a little more than a tenth."""
    left, right = _both(g, kind, a, b)
    if kind == "i":
        return pointwise(g, "idiv", [left, right], "i")
    zero, one = g.full(0.0, (), "f"), g.full(1.0, (), "f")
    rest = pointwise(g, "fmod", [left, right], "f")
    exact = pointwise(g, "div", [pointwise(g, "sub", [left, rest], "f"), right], "f")
    signs = [pointwise(g, "lt", [x, zero], "b") for x in (rest, right)]
    some = pointwise(g, "ne", [rest, zero], "b")
    below = pointwise(g, "and", [some, pointwise(g, "xor", signs, "b")], "b")
    exact = pointwise(g, "sub", [exact, pointwise(g, "to_f", [below], "f")], "f")
    floor = pointwise(g, "floor", [exact], "f")
    apart = pointwise(g, "sub", [exact, floor], "f")
    high = pointwise(g, "gt", [apart, g.full(0.5, (), "f")], "b")
    floor = pointwise(g, "where", [high, pointwise(g, "add", [floor, one], "f"), floor], "f")
    none = pointwise(g, "eq", [right, zero], "b")
    plain = pointwise(g, "div", [left, right], "f")
    return pointwise(g, "where", [none, plain, floor], "f")


@lowers("remainder.Tensor", "remainder.Scalar", "remainder.Scalar_Tensor")
def _remainder(g: Graph, kind: str, a: Any, b: Any) -> Node:
    name = "imod" if kind == "i" else "remainder"
    return pointwise(g, name, _both(g, kind, a, b), kind)


@lowers("fmod.Tensor", "fmod.Scalar")
def _fmod(g: Graph, kind: str, a: Any, b: Any) -> Node:
    left, right = _both(g, kind, a, b)
    if kind == "f":
        return pointwise(g, "fmod", [left, right], "f")
    zero = g.full(0, (), "i")
    rest = pointwise(g, "imod", [left, right], "i")
    other = pointwise(g, "ilt", [pointwise(g, "xor", [rest, left], "i"), zero], "b")
    some = pointwise(g, "ine", [rest, zero], "b")
    wrong = pointwise(g, "and", [some, other], "b")
    return pointwise(g, "where", [wrong, pointwise(g, "isub", [rest, right], "i"), rest], "i")


@lowers("round.decimals")
def _round(g: Graph, kind: str, x: Node, *, decimals: int) -> Node:
    ten = g.full(10.0 ** abs(decimals), (), "f")
    there, back = ("mul", "div") if decimals > 0 else ("div", "mul")
    whole = pointwise(g, "round", [pointwise(g, there, [x, ten], "f")], "f")
    return pointwise(g, back, [whole, ten], "f")


def _shift(name: str, op: str) -> None:
    forms = [f"__{name[0]}shift__.Scalar", f"bitwise_{name}_shift.Tensor_Scalar"]

    @lowers(*forms)
    def lower(g: Graph, kind: str, x: Node, places: Any) -> Node:
        if not isinstance(places, int) or not 0 <= places < 63:
            raise NotImplementedError("by another number than 0 to 62")
        factor = g.full(2**places, (), "i")
        return pointwise(g, op, [as_kind(g, x, "i"), factor], "i")


_shift("left", "imul")
_shift("right", "idiv")


@lowers("ldexp.Tensor")
def _ldexp(g: Graph, kind: str, x: Node, power: Node) -> Node:
    factor = pointwise(g, "exp2", [as_kind(g, power, "f")], "f")
    return pointwise(g, "mul", [as_kind(g, x, "f"), factor], "f")
