"""Pointwise operations and reductions, with the simplifications that a traced step calls for."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any

from .nodes import Graph, IndexMap, Node, Shape, number_of
from .reshapes import expand
from .views import view

_NAMES = """
    add sub mul div neg abs sqrt square exp exp2 expm1 log log2 log10 log1p sin cos tan asin
    acos copy atan atan2 sinh cosh tanh asinh acosh atanh sigmoid erf erfc pow powi reciprocal
    sign floor ceil trunc round fmod remainder max min copysign hypot lt le gt ge eq ne and or
    xor not where to_f to_i to_b iadd isub imul idiv imod ineg iabs imax imin ilt ile igt ige
    ieq ine
"""
#: Pointwise operations on lanes, by name; `cpp/expressions.py` has the text of each.
POINTWISE = frozenset(_NAMES.split())
_EITHER_WAY = "add mul max min and or xor eq ne iadd imul imax imin ieq ine"
COMMUTATIVE = frozenset(_EITHER_WAY.split())
#: What a reduction does, by name, and the value of an empty one.
REDUCTIONS = {"sum": 0.0, "prod": 1.0, "amax": -math.inf, "amin": math.inf}


def pointwise(
    g: Graph,
    op: str,
    args: Sequence[Node],
    kind: str,
    attributes: Any = (),
    shape: Shape | None = None,
) -> Node:
    """An operation on operands that broadcast."""
    if shape is None:
        shape = broadcast([a.shape for a in args])
    args = [expand(g, a, shape) for a in args]
    if op == "copy":
        return args[0]
    simpler = _simplified(g, op, args, kind, shape)
    if simpler is not None:
        return simpler
    if op in COMMUTATIVE:
        args.sort(key=lambda a: a.number)
    return g.node(op, args, shape, kind, attributes)


def broadcast(shapes: Sequence[Shape]) -> Shape:
    """The common shape."""
    rank = max((len(s) for s in shapes), default=0)
    padded = [(1,) * (rank - len(s)) + tuple(s) for s in shapes]
    return tuple(next((n for n in sizes if n != 1), 1) for sizes in zip(*padded, strict=True))


_FOLDS: dict[str, Callable[..., Any]] = {
    "add": lambda a, b: a + b,
    "sub": lambda a, b: a - b,
    "mul": lambda a, b: a * b,
    "neg": lambda a: -a,
    "iadd": lambda a, b: a + b,
    "isub": lambda a, b: a - b,
    "imul": lambda a, b: a * b,
    "eq": lambda a, b: a == b,
    "ne": lambda a, b: a != b,
    "lt": lambda a, b: a < b,
    "gt": lambda a, b: a > b,
    "le": lambda a, b: a <= b,
    "ge": lambda a, b: a >= b,
    "ieq": lambda a, b: a == b,
    "ine": lambda a, b: a != b,
    "not": lambda a: not a if isinstance(a, bool) else ~a,
    "and": lambda a, b: a & b,
    "or": lambda a, b: a | b,
    "to_f": float,
    "to_i": int,
    "to_b": bool,
}


def _wrapped(g: Graph, value: Any) -> Any:
    """An integer as its bits hold it."""
    whole = isinstance(value, int) and not isinstance(value, bool)
    return g.real.wrapped(value) if whole else value


def _simplified(g: Graph, op: str, args: list[Node], kind: str, shape: Shape) -> Node | None:
    numbers = [number_of(a) for a in args]
    if op in _FOLDS and all(n is not None for n in numbers):
        finite = all(math.isfinite(n) for n in numbers if n is not None)
        if finite or op not in ("to_i", "to_b"):
            return g.full(_wrapped(g, _FOLDS[op](*numbers)), shape, kind)
    if op == "where":
        condition = numbers[0]
        if condition is not None:
            return args[1] if condition else args[2]
        return args[1] if args[1] is args[2] else None
    if op in ("to_f", "to_i", "to_b") and args[0].kind == kind:
        return args[0]
    if op == "neg" and args[0].op == "neg":
        return args[0].args[0]
    if op == "not" and args[0].op == "not":
        return args[0].args[0]
    if kind == "b" and op in ("and", "or") and any(n is not None for n in numbers):
        known = next(i for i, n in enumerate(numbers) if n is not None)
        neutral = bool(numbers[known]) == (op == "and")
        return args[1 - known] if neutral else args[known]
    if kind != "f" or len(args) != 2:
        return None
    return _with_number(g, op, args, numbers, shape)


def _with_number(
    g: Graph, op: str, args: list[Node], numbers: list[Any], shape: Shape
) -> Node | None:
    """x + 0, x * 1, 0 * x, x / 2 and their like. 0 here stands for a gradient that nothing has."""
    a, b = args
    left, right = numbers
    if op == "add":
        if left == 0 or right == 0:
            return b if left == 0 else a
        if b.op == "neg":
            return pointwise(g, "sub", [a, b.args[0]], "f", (), shape)
        if a.op == "neg":
            return pointwise(g, "sub", [b, a.args[0]], "f", (), shape)
    if op == "sub":
        if right == 0:
            return a
        if left == 0:
            return pointwise(g, "neg", [b], "f", (), shape)
        if b.op == "neg":
            return pointwise(g, "add", [a, b.args[0]], "f", (), shape)
    if op == "mul":
        for number, other in ((left, b), (right, a)):
            if number == 0:
                return g.full(0.0, shape, "f")
            if number == 1:
                return other
            if number == -1:
                return pointwise(g, "neg", [other], "f", (), shape)
    if op == "div":
        if left == 0 and right != 0:
            return g.full(0.0, shape, "f")
        if right == 1:
            return a
        if right is not None and right != 0 and math.frexp(right)[0] in (0.5, -0.5):
            return pointwise(g, "mul", [a, g.full(1.0 / right, shape, "f")], "f", (), shape)
        shared = b.op == "view" and b.args[0].size < b.size
        if shared:  # one division for all
            once = pointwise(g, "reciprocal", [b.args[0]], "f")
            return pointwise(g, "mul", [a, view(g, once, shape, b.attributes)], "f", (), shape)
    return None


def reduce(g: Graph, op: str, x: Node, dims: Sequence[int], kind: str | None = None) -> Node:
    """Reduction over `dims`, which vanish; `kind` where the result is of another."""
    kept = tuple(n for d, n in enumerate(x.shape) if d not in dims)
    kind = x.kind if kind is None else kind
    count = math.prod(x.shape[d] for d in dims)
    if op not in ("argmax", "argmin") and count == 1:
        maps, place = [], 0
        for d in range(len(x.shape)):
            maps.append(
                IndexMap(0, tuple(int(i == place and d not in dims) for i in range(len(kept))))
            )
            place += d not in dims
        return view(g, x, kept, maps)
    if count == 0 and op in REDUCTIONS:
        return g.full(REDUCTIONS[op] if kind == "f" else int(op == "prod"), kept, kind)
    number = number_of(x)
    if op == "sum" and number is not None:
        return g.full(number * count, kept, kind)
    return g.node(op, (x,), kept, kind, tuple(sorted(dims)))
