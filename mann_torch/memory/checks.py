"""Tensors that go into a memory, checked: their shapes, dtypes and common batch."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import AbstractContextManager, nullcontext
from typing import Any

import torch
from torch import Tensor

from ..errors import DtypeError, ShapeError

Sizes = tuple[int, ...]
#: A tensor's name, the tensor, its last dimensions and its dtype.
Row = tuple[str, Any, Sizes, torch.dtype | None]


def check_tensor(name: str, value: Any, tail: Sizes, dtype: torch.dtype | None) -> Sizes:
    """The batch shape of a tensor (..., *tail). Raises `ShapeError`, `DtypeError`.

    No `dtype`: any floating-point one.
    """
    if not isinstance(value, Tensor):
        raise DtypeError(f"{name} is {type(value).__name__}, not a tensor")
    fits = value.is_floating_point() if dtype is None else value.dtype == dtype
    if not fits:
        wanted = "floating-point numbers" if dtype is None else str(dtype)
        raise DtypeError(f"{name} is {value.dtype}; a memory takes {wanted} here")
    split = value.dim() - len(tail)
    if split < 0 or tuple(value.shape[split:]) != tail:
        raise ShapeError(f"{name} has shape {tuple(value.shape)}, not (..., {_listed(tail)})")
    return tuple(value.shape[:split])


def autocast_is_on(device: torch.device) -> bool:
    """Whether layers before this one may hand over any precision, as torch's own do."""
    kind = device.type
    return torch.amp.is_autocast_available(kind) and torch.is_autocast_enabled(kind)


def exactly(device: torch.device) -> AbstractContextManager[Any]:
    """A region where autocast, if it is on, leaves dtypes alone: what a memory holds is exact."""
    if not autocast_is_on(device):
        return nullcontext()
    return torch.autocast(device.type, enabled=False)


def common_batch(shapes: Mapping[str, Sizes]) -> Sizes:
    """What batch shapes broadcast to. Raises `ShapeError` naming them."""
    batch: list[int] = [1] * max(map(len, shapes.values()))
    for shape in shapes.values():
        for place in range(-len(shape), 0):
            if shape[place] == 1:
                continue
            if batch[place] not in (1, shape[place]):
                listed = ", ".join(f"{name} {tuple(shape)}" for name, shape in shapes.items())
                raise ShapeError(f"batch shapes do not fit: {listed}")
            batch[place] = shape[place]
    return tuple(batch)


def check_together(rows: Sequence[Row]) -> Sizes:
    """The common batch shape of tensors, each checked. Raises `ShapeError`, `DtypeError`."""
    return common_batch({row[0]: check_tensor(*row) for row in rows})


def check_within(name: str, shape: Sizes, batch: Sizes) -> None:
    """Raise `ShapeError` for a batch shape that would enlarge the batch."""
    if common_batch({name: shape, "the batch": batch}) != batch:
        raise ShapeError(f"batch shapes do not fit: {name} {shape} in a batch of {batch}")


def _listed(tail: Sizes) -> str:
    return ", ".join(map(str, tail))
