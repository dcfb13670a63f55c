"""What torch does by way of a Python number, done with tensors while a step is traced.

A row of a table chosen by an integer tensor (`x[k]`, `x[k] = y`), and one-hot vectors: torch asks
for the number, which a trace does not have.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import torch
from torch import Tensor
from torch.overrides import TorchFunctionMode

_WHOLE = (torch.int64, torch.int32, torch.int16, torch.int8, torch.uint8)


class Choosing(TorchFunctionMode):
    """While it is in force, an integer tensor of no dimensions chooses as a number would."""

    def __torch_function__(
        self,
        func: Callable[..., Any],
        types: Sequence[type],
        args: Sequence[Any] = (),
        kwargs: dict[str, Any] | None = None,
    ) -> Any:
        given = kwargs or {}
        if func is Tensor.__getitem__ and _chooses(args[1]):
            return _chosen(args[0], _entries(args[1]))
        if func is Tensor.__setitem__ and _chooses(args[1]) and _plain(_entries(args[1])):
            return _put(args[0], _entries(args[1]), args[2])
        if func is torch.nn.functional.one_hot:
            return _one_hot(func, *args, **given)
        return func(*args, **given)


def _entries(index: Any) -> tuple[Any, ...]:
    return index if isinstance(index, tuple) else (index,)


def _is_number(entry: Any) -> bool:
    return isinstance(entry, Tensor) and entry.dim() == 0 and entry.dtype in _WHOLE


def _chooses(index: Any) -> bool:
    return any(map(_is_number, _entries(index)))


def _plain(entries: Sequence[Any]) -> bool:
    """Whether there is no list and no tensor with dimensions among them."""
    return all(
        entry is None
        or entry is Ellipsis
        or isinstance(entry, slice)
        or (isinstance(entry, int) and not isinstance(entry, bool))
        or _is_number(entry)
        for entry in entries
    )


def _width(entry: Any) -> int:
    """How many dimensions an entry takes up."""
    if entry is None or entry is Ellipsis or isinstance(entry, bool):
        return 0
    masks = isinstance(entry, Tensor) and entry.dtype == torch.bool
    return entry.dim() if masks else 1


def _chosen(x: Tensor, entries: Sequence[Any]) -> Tensor:
    """x[entries]."""
    rest = x.dim() - sum(map(_width, entries))
    dim, plain = 0, []
    for entry in entries:
        if _is_number(entry):
            place = torch.where(entry < 0, entry + x.shape[dim], entry)
            x = x.index_select(dim, place.long().reshape(1))
            entry = 0
        plain.append(entry)
        dim += rest if entry is Ellipsis else _width(entry)
    return x[tuple(plain)]


def _put(x: Tensor, entries: Sequence[Any], value: Any) -> None:
    """x[entries] = value."""
    target = x[tuple(slice(None) if _is_number(entry) else entry for entry in entries)]
    rest = x.dim() - sum(map(_width, entries))
    dim, places, here = 0, [], torch.ones((), dtype=torch.bool)
    for entry in entries:
        if _is_number(entry):
            size = target.shape[dim]
            along = torch.arange(size).reshape(size, *(1,) * (target.dim() - dim - 1))
            here = here & (along == torch.where(entry < 0, entry + size, entry))
            places.append(dim)
        if entry is Ellipsis:
            dim += rest
        elif not isinstance(entry, int):
            dim += 1
    if isinstance(value, Tensor):
        shape = [n for d, n in enumerate(target.shape) if d not in places]
        while value.dim() > len(shape) and value.shape[0] == 1:
            value = value[0]
        value = value.expand(shape).to(x.dtype)
        for place in places:
            value = value.unsqueeze(place)
    target.copy_(torch.where(here, value, target))


def _one_hot(one_hot: Callable[..., Tensor], x: Tensor, num_classes: int = -1) -> Tensor:
    if num_classes < 0:
        return one_hot(x, num_classes)  # asks for the largest
    return (x.unsqueeze(-1) == torch.arange(num_classes)).long()
