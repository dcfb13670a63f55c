"""Operations that torch's ONNX exporter writes so that they lose digits, or onnxruntime lacks."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import torch
from onnxscript import ir
from onnxscript import opset18 as op


def table() -> dict[Callable[..., Any], Callable[..., Any]]:
    """Ours, by torch's operation."""
    aten = torch.ops.aten
    return {
        aten.where.self: where,
        aten.expm1.default: expm1,
        aten.scalar_tensor.default: scalar_tensor,
        aten.full_like.default: full_like,
        aten.minimum.default: minimum,
        aten.maximum.default: maximum,
        aten.clamp.default: clamp,
        aten.clamp.Tensor: clamp_between,
    }


def where(condition: Any, self: Any, other: Any) -> Any:
    """Of masks onnxruntime has no `Where`."""
    if self.dtype != ir.DataType.BOOL:
        return op.Where(condition, self, other)
    return op.Or(op.And(condition, self), op.And(op.Not(condition), other))


def expm1(self: Any) -> Any:
    """e^x - 1 = tanh(x / 2) (e^x + 1): the difference would lose what a short period leaves."""
    half = op.Mul(self, op.CastLike(0.5, self))
    return op.Mul(op.Tanh(half), op.Add(op.Exp(self), op.CastLike(1.0, self)))


def minimum(self: Any, other: Any) -> Any:
    """Without `Min`, which onnxscript fuses: two `Clip` of one number under the same name, and not
    a number is lost in it.
    """
    return op.Where(_first(op.Less(self, other), self), self, other)


def maximum(self: Any, other: Any) -> Any:
    """As `minimum`."""
    return op.Where(_first(op.Greater(self, other), self), self, other)


def clamp(self: Any, min: float | None = None, max: float | None = None) -> Any:
    """As `minimum`, between numbers of Python."""
    bounds = (None if x is None else _constant(x, (), self.dtype) for x in (min, max))
    return clamp_between(self, *bounds)


def clamp_between(self: Any, min: Any = None, max: Any = None) -> Any:
    """As `minimum`."""
    raised = self if min is None else maximum(self, min)
    return raised if max is None else minimum(raised, max)


def scalar_tensor(
    s: float, dtype: int = 1, layout: str = "", device: str = "", pin_memory: bool = False
) -> Any:
    """Numbers of Python: the exporter rounds them to float32 on their way."""
    return _constant(s, (), ir.DataType(dtype))


def full_like(
    self: Any,
    fill_value: float,
    dtype: int = -1,
    layout: str = "",
    device: str = "",
    pin_memory: bool = False,
    memory_format: str = "",
) -> Any:
    """As `scalar_tensor`."""
    kind = self.dtype if dtype == -1 else ir.DataType(dtype)
    return _constant(fill_value, self.shape.numpy(), kind)


def _first(holds: Any, x: Any) -> Any:
    """Where `holds`, or x is not a number and stays that."""
    return op.Or(holds, op.IsNaN(x)) if x.dtype.is_floating_point() else holds


def _constant(value: float, shape: tuple[int, ...], kind: ir.DataType) -> Any:
    return op.Constant(value=ir.tensor(np.full(shape, value, kind.numpy())))
