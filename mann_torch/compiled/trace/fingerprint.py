"""What a traced step depends on besides tensors: the key under which its program is kept."""

from __future__ import annotations

import types
from collections.abc import Hashable
from typing import Any

import numpy as np
from torch import Tensor, nn

#: What every module has: tensors and parts, told otherwise, and hooks, with which none is compiled.
_SKIPPED = frozenset(vars(nn.Module())) - {"training"}
_NUMBERS = (int, float, complex, bool, str, bytes, type(None), type)
#: Containers nested deeper than this are known by identity.
_DEPTH = 8


class Fingerprint:
    """Keys of objects by value; `alive` holds those known by identity, so that none is reused."""

    def __init__(self) -> None:
        self.alive: list[Any] = []

    def of(self, value: Any, depth: int = 0) -> Hashable:
        """A key that changes with any number, flag, type or structure in the object."""
        if isinstance(value, _NUMBERS):
            # 1, 1.0 and True are equal, nan is not itself.
            return (type(value), repr(value) if not isinstance(value, type) else value)
        if isinstance(value, Tensor):
            return ("tensor", value.dtype, value.dim())
        if isinstance(value, np.ndarray) and value.dtype != object:
            return ("array", value.dtype.str, value.shape, value.tobytes())
        if isinstance(value, nn.Module):
            return self._module(value, depth)
        if depth < _DEPTH:
            if isinstance(value, (tuple, list)):
                return (type(value), *(self.of(v, depth + 1) for v in value))
            if isinstance(value, dict):
                items = ((self.of(k, depth + 1), self.of(v, depth + 1)) for k, v in value.items())
                return (type(value), *items)
            if isinstance(value, (types.FunctionType, types.MethodType)):
                return self._function(value, depth)
            if hasattr(value, "__dict__"):
                return (type(value), self.of(vars(value), depth + 1))
        self.alive.append(value)
        return (type(value), id(value))

    def _module(self, module: nn.Module, depth: int) -> Hashable:
        own = {k: v for k, v in vars(module).items() if k not in _SKIPPED}
        # A part of a part, however deep, is no deeper a container.
        parts = tuple((n, self.of(m, depth)) for n, m in module.named_children())
        none = tuple(n for n, p in module._parameters.items() if p is None)
        return (type(module), self.of(own, depth + 1), none, parts)

    def _function(self, value: Any, depth: int) -> Hashable:
        function = getattr(value, "__func__", value)
        cells = function.__closure__ or ()
        inside = tuple(self.of(c.cell_contents, depth + 1) for c in cells)
        return (function.__code__, inside, self.of(function.__defaults__ or (), depth + 1))
