"""The rows of a reference: what is not among them, and copies with others."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Any

import torch
from torch import Tensor, nn

from ..signals import Reference, Rows
from .forms import has_tensor
from .telling import broken

#: How many numbers of its rows are tried as times.
MOST_KNOTS = 64


def check_registered(reference: Reference) -> None:
    """Raise `InterfaceError` for tensors that `expand`, `select` and `stack` would leave behind."""
    for path, module in reference.named_modules():
        held = module.held() if isinstance(module, Rows) else {}
        for name, value in _attributes(module):
            if name not in held and has_tensor(value):
                raise broken(
                    reference,
                    1,
                    f"{f'{path}.{name}'.removeprefix('.')} is a tensor that does not expand",
                    "register it: self.hold(name, rows, event_dims)",
                )
    for name in ("width", "order"):
        value = getattr(reference, name, None)
        if isinstance(value, bool) or not isinstance(value, int) or value < 0:
            raise broken(reference, 2, f"{name} = {value!r}", f"set `{name}` to a whole number")


def _attributes(module: nn.Module) -> Iterator[tuple[str, Any]]:
    for name, value in vars(module).items():
        if name in ("_parameters", "_buffers"):
            yield from value.items()
        elif name != "_modules":
            yield name, value


def _rows(reference: Reference) -> Iterable[tuple[str, Rows, str, Tensor]]:
    """Path, owner, name and rows of all that is held."""
    for path, module in reference.named_modules():
        if isinstance(module, Rows):
            for name, rows in module.held().items():
                yield f"{path}.{name}".removeprefix("."), module, name, rows


def _copy(reference: Reference) -> Reference:
    """A twin of the same rows, which may be put in place of others."""
    return reference.expand(reference.batch_shape)


def numbers_in(reference: Reference) -> Tensor:
    """Finite numbers >= 0 of its rows, some of them: times among them."""
    rows = [rows.detach().reshape(-1) for _, _, _, rows in _rows(reference)]
    found = torch.unique(torch.cat([*rows, torch.zeros(1, dtype=torch.float64)]))
    return found[torch.isfinite(found) & (found >= 0)][:MOST_KNOTS]


def scaled_copies(reference: Reference, count: int) -> Reference:
    """A batch (count, ...) of it with unlike members: all rows 1 % larger from one to the next."""
    batch = reference.expand((count, *reference.batch_shape))
    for _, owner, name, rows in list(_rows(batch)):
        factors = 1.0 + 0.01 * torch.arange(count, dtype=torch.float64)
        setattr(owner, name, rows * factors.reshape(count, *(1,) * (rows.dim() - 1)))
    return batch


def members(batch: Reference) -> Iterator[Reference]:
    """Each member of the first batch dimension, without that dimension."""
    for i in range(batch.batch_shape[0]):
        alone = _copy(batch)
        for _, owner, name, rows in list(_rows(alone)):
            setattr(owner, name, rows[i])
        yield alone


def leaves_of(reference: Reference) -> tuple[Reference, dict[str, Tensor]]:
    """A copy whose rows all require grad, and these rows by name."""
    copy, leaves = _copy(reference), {}
    for path, owner, name, rows in list(_rows(copy)):
        leaves[path] = rows.detach().clone().requires_grad_()
        setattr(owner, name, leaves[path])
    return copy, leaves
