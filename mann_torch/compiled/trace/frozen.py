"""Copies of modules that a program may keep: their structure and numbers, not their tensors."""

from __future__ import annotations

import copy
from typing import Any, TypeVar

from torch import Tensor, nn

Module = TypeVar("Module", bound=nn.Module)


def frozen(module: Module) -> Module:
    """A copy of a module and its parts with the very tensors of the original.

    Tracing puts other tensors in their place for a while, which nobody else should see; and a
    derivative traced later should meet the numbers of the first trace, whatever was changed since.
    """
    return _copied(module, {})


def _copied(module: Any, known: dict[int, Any]) -> Any:
    twin = known.get(id(module))
    if twin is None:
        twin = known[id(module)] = copy.copy(module)
        for name, value in vars(module).items():
            twin.__dict__[name] = _held(value, known)
    return twin


def _held(value: Any, known: dict[int, Any]) -> Any:
    if isinstance(value, nn.Module):
        return _copied(value, known)
    if isinstance(value, dict):
        kept = copy.copy(value)
        kept.update({key: _held(v, known) for key, v in value.items()})
        return kept
    if isinstance(value, list):
        return [_held(v, known) for v in value]
    if isinstance(value, Tensor) or not hasattr(value, "__dict__") or callable(value):
        return value
    return copy.copy(value)
