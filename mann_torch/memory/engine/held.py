"""A cell's tensors as the compiled engine (`mann_torch.compiled`) takes them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import torch
from torch import Tensor

from ...compiled import Row, missing, transformed
from ...constraints import DesignModule
from ..cells.cell import MemoryCell

_DTYPES = (torch.float32, torch.float64)


def obstacle(cell: MemoryCell, parts: Sequence[str], device: torch.device) -> str | None:
    """Why steps through these parts can't even be tried, in a few words; None if they can."""
    if torch.compiler.is_compiling():
        return "torch.compile and torch.export take the steps themselves"
    if cell.dtype not in _DTYPES:
        return f"the compiled engine computes in float32 and float64, not {cell.dtype}"
    if device.type not in ("cpu", "cuda"):
        return f"there is no compiled engine on {device.type}"
    traced = (m for name in parts for m in cell.get_submodule(name).modules())
    if any(m._forward_hooks or m._forward_pre_hooks for m in traced):
        return "forward hooks are not called by the compiled engine"
    if transformed():
        return "torch.func and forward-mode differentiation need the torch engine"
    return missing()


class Held(NamedTuple):
    """The tensors of a cell that its steps may read, by dotted name."""

    names: list[str]
    tensors: list[Tensor]
    events: list[int]  # trailing dimensions of one sample's value

    @classmethod
    def of(cls, cell: MemoryCell, parts: Sequence[str]) -> Held:
        """Those of some parts of the cell, and what a run starts from."""
        found: dict[str, Tensor] = {**dict(cell.named_parameters(recurse=False)), "dt": cell.dt}
        events: dict[str, int] = {"dt": 0}
        for name in parts:
            part = cell.get_submodule(name)
            found |= {f"{name}.{n}": t for n, t in part.named_parameters()}
            found |= {f"{name}.{n}": t for n, t in part.named_buffers()}
            for prefix, inner in part.named_modules(prefix=name):
                if isinstance(inner, DesignModule):
                    for own, domain in inner.domains().items():
                        found[f"{prefix}.{own}"] = getattr(inner, own)
                        events[f"{prefix}.{own}"] = domain.event_dims
        return cls(
            list(found), list(found.values()), [events.get(n, t.dim()) for n, t in found.items()]
        )

    def rows(self, batch: torch.Size) -> list[Row]:
        """Each as it is where it is for all samples, else (B, *event)."""
        return [_row(t, e, batch) for t, e in zip(self.tensors, self.events, strict=True)]


def _row(x: Tensor, event_dims: int, batch: torch.Size) -> Row:
    if x.is_floating_point() and x.dim() == event_dims:
        return Row(x, True)
    event = x.shape[x.dim() - event_dims :]
    return Row(x.expand((*batch, *event)).reshape((batch.numel(), *event)), False)
