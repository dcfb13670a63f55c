"""What may be of another precision than the arithmetic of a program."""

from __future__ import annotations

from typing import Any

import torch
from torch.fx import Node as Traced

from ..real import DOUBLE, Real

_NAMES = """
    full scalar_tensor view expand unsqueeze squeeze alias zeros ones empty full_like zeros_like
    ones_like lift_fresh_copy clone detach where select slice cat permute
"""
#: What may be float32 among float64: it only makes or moves constants, exact in float64.
_CONSTANT = frozenset(_NAMES.split())
_CONVERTS = ("_to_copy", "convert_element_type", "prims")


def check_precision(real: Real, name: str, traced: Traced, dtype: torch.dtype) -> None:
    """Raise `NotImplementedError` for arithmetic in anything but the program's own."""
    operation = name.split(".")[0]
    if real is not DOUBLE:
        _check_operands(operation, traced)
    if not (dtype.is_floating_point or dtype.is_complex) or dtype == real.dtype:
        return
    whole = (
        operation == "_to_copy" and not traced.args[0].meta["val"].is_floating_point()  # type: ignore[union-attr]
    )
    exact = real is DOUBLE and dtype == torch.float32
    if not (exact and (operation in _CONSTANT or whole)):
        own = str(real.dtype).removeprefix("torch.")
        raise NotImplementedError(f"{name} computes in {dtype}, not in {own}")


def _check_operands(operation: str, traced: Traced) -> None:
    """What compares float32 with float64 numbers has no floating result that would show it."""
    if operation in _CONVERTS:
        return
    given = [node.meta.get("val") for node in traced.all_input_nodes]
    floating = [x for x in given if isinstance(x, torch.Tensor) and x.is_floating_point()]
    finer = [x for x in floating if x.dtype == torch.float64]
    least = max((x.dim() for x in floating if x.dtype != torch.float64), default=0)
    if any(x.dim() > 0 or least == 0 for x in finer):
        raise NotImplementedError("a float64 operand among float32 ones")


def rounded(value: Any, dtype: torch.dtype) -> Any:
    """A Python number as a float32 constant holds it."""
    if dtype == torch.float32 and isinstance(value, float):
        return float(torch.tensor(value, dtype=torch.float32))
    return value
