"""The C++ text of each pointwise operation on lanes; the functions are those of `lanes`."""

from __future__ import annotations

import math

from ..graph.nodes import Node
from ..real import DOUBLE, Real

_SAME = "exp exp2 expm1 log log2 log10 log1p sin cos tan asin acos atan atan2 sinh cosh tanh asinh"
_SAME += " acosh atanh sigmoid erf erfc pow sign floor ceil trunc round fmod remainder max min"
_SAME += " copysign hypot sqrt abs"
_AS_THEY_ARE = "lt le gt ge eq ne ilt ile igt ige ieq ine imax imin idiv imod"

#: Operation -> text with {0}, {1}, {2} for its operands.
TEXT: dict[str, str] = {
    "copy": "{0}",
    "add": "({0} + {1})",
    "sub": "({0} - {1})",
    "mul": "({0} * {1})",
    "div": "({0} / {1})",
    "neg": "(-{0})",
    "reciprocal": "(splat(1.0) / {0})",
    "iadd": "iadd({0}, {1})",
    "isub": "isub({0}, {1})",
    "imul": "imul({0}, {1})",
    "ineg": "isub(isplat(0), {0})",
    "iabs": "imax({0}, isub(isplat(0), {0}))",
    "and": "({0} & {1})",
    "or": "({0} | {1})",
    "xor": "({0} ^ {1})",
    "not": "(~{0})",
}
for _name in _SAME.split():
    TEXT[_name] = (
        f"{_name}_({{0}}, {{1}})"
        if _name in ("atan2", "pow", "fmod", "remainder", "max", "min", "copysign", "hypot")
        else f"{_name}_({{0}})"
    )
for _name in _AS_THEY_ARE.split():
    TEXT[_name] = f"{_name}({{0}}, {{1}})"

_CASTS = {
    ("b", "f"): "mask_to_double({0})",
    ("i", "f"): "to_double({0})",
    ("f", "i"): "to_int({0})",
    ("b", "i"): "({0} & isplat(1))",
    ("f", "b"): "ne({0}, splat(0.0))",
    ("i", "b"): "ine({0}, isplat(0))",
}


def text_of(node: Node) -> str:
    """The text of a pointwise node."""
    if node.op == "where":
        return "sel({0}, {1}, {2})" if node.kind == "f" else "isel({0}, {1}, {2})"
    if node.op.startswith("to_"):
        return _CASTS[node.args[0].kind, node.kind]
    return TEXT[node.op]


def literal(kind: str, text: str, real: Real = DOUBLE) -> str:
    """A number, the same in every lane; `text` is its repr."""
    if kind == "f":
        value = float(text)
        if math.isnan(value):
            return "nan_()"
        if math.isinf(value):
            return "inf_()" if value > 0 else "(-inf_())"
        return f"splat({number(text, real)})"
    if kind == "b":
        return f"isplat({-1 if text == 'True' else 0})"
    return f"isplat({whole(text)})"


def whole(text: str) -> str:
    """An integer in C++; the smallest one, whose opposite is none, as a difference."""
    smallest = -(2**63)
    return f"({smallest + 1}ll - 1)" if int(text) == smallest else f"{text}ll"


def number(text: str, real: Real) -> str:
    """A floating number in C++, exactly; what is not finite, by a division NVRTC knows too."""
    value, f = float(text), real.suffix
    if math.isnan(value):
        return f"(0.0{f} / 0.0{f})"
    if math.isinf(value):
        return f"(1.0{f} / 0.0{f})" if value > 0 else f"(-1.0{f} / 0.0{f})"
    if not value:
        return f"{'-' if math.copysign(1.0, value) < 0 else ''}0.0{f}"
    return value.hex() + f


def type_of(kind: str) -> str:
    """V for floating numbers, M for integers and masks."""
    return "V" if kind == "f" else "M"
