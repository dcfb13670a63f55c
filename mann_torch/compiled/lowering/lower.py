"""A traced torch.fx graph as nodes."""

from __future__ import annotations

import inspect
import operator
from collections.abc import Sequence
from typing import Any

import torch
from torch.fx import GraphModule
from torch.fx import Node as Traced

from ..graph import Graph, Node
from ..tracing import Untraceable, attribute_of, source_of
from .registry import KIND_OF, LOWERINGS, kind_of


def lower(g: Graph, made: GraphModule, inputs: Sequence[Node]) -> list[Node]:
    """The results of a trace whose placeholders are `inputs`.

    Raises `Untraceable` for an operation without a lowering, by its name and source line.
    """
    values: dict[Traced, Any] = {}
    given = iter(inputs)
    for traced in made.graph.nodes:
        if traced.op == "placeholder":
            values[traced] = next(given)
        elif traced.op == "get_attr":
            values[traced] = _constant(g, attribute_of(made, str(traced.target)))
        elif traced.op == "call_function":
            if traced.users:
                values[traced] = _called(g, traced, values)
        else:
            (results,) = traced.args
            return [_value(r, values) for r in results]  # type: ignore[union-attr]
    return []


def _constant(g: Graph, tensor: torch.Tensor) -> Node:
    return g.table(tensor.detach().reshape(-1).tolist(), tuple(tensor.shape), _kind(tensor.dtype))


def _kind(dtype: torch.dtype) -> str:
    # A float32 constant is exact in float64; arithmetic in float32 is not.
    return "f" if dtype == torch.float32 else kind_of(dtype)


def _value(argument: Any, values: dict[Traced, Any]) -> Any:
    if isinstance(argument, Traced):
        return values[argument]
    if isinstance(argument, (list, tuple)):
        return [_value(a, values) for a in argument]
    return argument


def _called(g: Graph, traced: Traced, values: dict[Traced, Any]) -> Any:
    args = [_value(a, values) for a in traced.args]
    if traced.target is operator.getitem:
        return args[0][args[1]]
    name = str(traced.target).removeprefix("aten.")
    function = LOWERINGS.get(name)
    if function is None:
        raise Untraceable(f"operation {name} has no compiled form{source_of(traced)}")
    result = traced.meta["val"]
    first = result[0] if isinstance(result, (list, tuple)) else result
    _check_precision(name, traced, first.dtype)
    args = [_rounded(a, first.dtype) for a in args]
    keywords = {k: _value(v, values) for k, v in traced.kwargs.items()}
    for dropped in ("dtype", "layout", "device", "pin_memory", "memory_format", "non_blocking"):
        keywords.pop(dropped, None)
    if "shape" in _parameters(function):
        keywords["shape"] = tuple(first.shape)
    try:
        return function(g, _kind(first.dtype), *args, **keywords)
    except (Untraceable, NotImplementedError, TypeError) as error:
        raise Untraceable(f"{name}: {error}{source_of(traced)}") from error


def _parameters(function: Any) -> Any:
    return inspect.signature(function).parameters


#: What may be float32: it only makes or moves constants, exact in float64.
_CONSTANT = frozenset(
    "full scalar_tensor view expand unsqueeze squeeze alias arange zeros ones empty full_like "
    "zeros_like ones_like lift_fresh_copy clone detach where select slice cat permute".split()
)


def _check_precision(name: str, traced: Traced, dtype: torch.dtype) -> None:
    """Raise `Untraceable` for arithmetic in anything but float64."""
    if dtype in KIND_OF or not (dtype.is_floating_point or dtype.is_complex):
        return
    operation = name.split(".")[0]
    whole = operation == "_to_copy" and not traced.args[0].meta["val"].is_floating_point()  # type: ignore[union-attr]
    if dtype != torch.float32 or not (operation in _CONSTANT or whole):
        raise Untraceable(f"{name} computes in {dtype}, not in float64{source_of(traced)}")


def _rounded(value: Any, dtype: torch.dtype) -> Any:
    """A Python number as a float32 constant holds it."""
    if dtype == torch.float32 and isinstance(value, float):
        return float(torch.tensor(value, dtype=torch.float32))
    return value
