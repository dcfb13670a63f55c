"""A traced torch.fx graph as nodes."""

from __future__ import annotations

import functools
import inspect
import logging
import operator
from collections.abc import Callable, Sequence
from typing import Any

import torch
from torch.fx import GraphModule
from torch.fx import Node as Traced

from ...telling import misread
from ..graph.nodes import Graph, Node
from ..real import DOUBLE
from ..trace.telling import UntraceableError, source_of
from .constants import Constants, random
from .precision import check_precision, rounded
from .registry import LOWERINGS, kind_of, kinds_of

log = logging.getLogger("mann_torch")


def lower(g: Graph, made: GraphModule, inputs: Sequence[Node]) -> list[Node]:
    """The results of a trace whose placeholders are `inputs`.

    Raises `UntraceableError` for an operation without a lowering, by its name and source line.
    """
    values: dict[Traced, Any] = {}
    constants = Constants(made)
    given = iter(inputs)
    for traced in made.graph.nodes:
        if traced.op == "placeholder":
            values[traced] = next(given)
        elif traced.op == "get_attr":
            values[traced] = _constant(g, constants.of(traced))
        elif traced.op == "call_function":
            if traced.users:
                values[traced] = _called(g, traced, values, constants)
        else:
            results: Any = traced.args[0]
            g.forget()
            return [_value(r, values) for r in results]
    return []


def _constant(g: Graph, value: Any) -> Any:
    if not isinstance(value, torch.Tensor):
        return tuple(_constant(g, v) for v in value)
    if value.is_complex():
        raise UntraceableError("complex numbers")
    whole = not (value.is_floating_point() or value.dtype == torch.bool)
    kind = "i" if whole else _kind(g, value.dtype)  # of whatever width: a number is a number
    try:
        return g.table(value.detach().reshape(-1).tolist(), tuple(value.shape), kind)
    except NotImplementedError as error:
        raise UntraceableError(f"a constant of {error}") from error


def _kind(g: Graph, dtype: torch.dtype) -> str:
    # A constant of the other precision is held in ours; arithmetic in it is refused.
    return "f" if dtype in (torch.float32, torch.float64) else kind_of(g.real, dtype)


def _value(argument: Any, values: dict[Traced, Any]) -> Any:
    if isinstance(argument, Traced):
        return values[argument]
    if isinstance(argument, (list, tuple)):
        return [_value(a, values) for a in argument]
    return argument


def _called(g: Graph, traced: Traced, values: dict[Traced, Any], constants: Constants) -> Any:
    if traced.target is operator.getitem:
        return values[traced.args[0]][traced.args[1]]  # type: ignore[index]
    name = str(traced.target).removeprefix("aten.")
    tensors = _tensors(name, traced)
    own = tensors[0].dtype
    if own == torch.float32 and g.real is DOUBLE and name.startswith("lift_fresh"):
        _warn_of(misread(constants.of(traced)))
    alike = own in kinds_of(g.real) or own == torch.int32
    if not alike and traced in constants:
        return _constant(g, constants.of(traced))
    function = LOWERINGS.get(name)
    try:
        if function is None:
            raise NotImplementedError(f"operation {name} has no compiled form")
        check_precision(g.real, name, traced, own)
        return _lowered(g, traced, values, function, tensors[0])
    except Exception as error:  # also forms of an operation that its lowering did not foresee
        if traced in constants:
            return _constant(g, constants.of(traced))
        text = str(error) if name in str(error) else f"{name}: {error}"
        raise UntraceableError(text + source_of(traced)) from error


@functools.cache
def _warn_of(number: str) -> None:
    """Once: it is computed with as torch does, and was hardly meant."""
    if number:
        log.warning(
            "a step has a float32 constant in which %s: give it dtype=torch.float64", number
        )


def _tensors(name: str, traced: Traced) -> list[torch.Tensor]:
    """What torch says the results are like."""
    result = traced.meta.get("val")
    tensors: list[Any] = list(result) if isinstance(result, (list, tuple)) else [result]
    if not isinstance(tensors[0], torch.Tensor):
        what = f"a Python number made of data ({name}: `.item()`, `int(tensor)`)"
        raise UntraceableError(what + source_of(traced))
    if random(traced):
        raise UntraceableError(f"{name} draws random numbers{source_of(traced)}")
    return tensors


def _lowered(
    g: Graph,
    traced: Traced,
    values: dict[Traced, Any],
    function: Callable[..., Any],
    like: torch.Tensor,
) -> Any:
    args = [rounded(_value(a, values), like.dtype) for a in traced.args]
    keywords = {k: _value(v, values) for k, v in traced.kwargs.items()}
    for dropped in ("dtype", "layout", "device", "pin_memory", "memory_format", "non_blocking"):
        keywords.pop(dropped, None)
    asked = inspect.signature(function).parameters
    if "shape" in asked:
        keywords["shape"] = tuple(like.shape)
    if "like" in asked:  # the first operand as torch has it
        keywords["like"] = traced.args[0].meta["val"]  # type: ignore[union-attr]
    return function(g, _kind(g, like.dtype), *args, **keywords)
