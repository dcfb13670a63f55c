"""The tensors that a task's loop and signals hold: a row a sample, by name."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import torch
from torch import Tensor, nn

from ...constraints import DesignModule, held_tensors
from ...signals import Surroundings
from ..task import Task


@dataclass(frozen=True)
class Part:
    """A tensor of the loop or the signals by name, one row a sample of the flat batch."""

    name: str
    rows: Tensor  # (B, *event)


def _event_dims(module: nn.Module, names: Sequence[str]) -> dict[str, int | None]:
    """Trailing dimensions that make one value of each design constant; None for other tensors."""
    found: dict[str, int | None] = dict.fromkeys(names)
    for prefix, part in module.named_modules():
        if isinstance(part, DesignModule):
            for name, domain in part.domains().items():
                found[f"{prefix}.{name}" if prefix else name] = domain.event_dims
    return found


def as_rows(value: Tensor, batch: torch.Size, event_dims: int | None) -> Tensor:
    """(..., *event) -> (B, *event); without `event_dims` the whole tensor is one sample's."""
    count = value.dim() if event_dims is None else event_dims
    event = value.shape[value.dim() - count :]
    return value.expand((*batch, *event)).reshape((batch.numel(), *event))


def loop_parts(task: Task) -> list[Part]:
    """All tensors that the loop holds."""
    held = held_tensors(task.loop)
    dims = _event_dims(task.loop, list(held))
    return [Part(n, as_rows(value, task.batch, dims[n])) for n, value in held.items()]


def single_surroundings(task: Task) -> Surroundings:
    """The signals as one sample has them, or, where samples differ, the batch's."""
    given = task.scenario.surroundings
    return task.surroundings if given.batch_shape else given.expand(())


def surrounding_parts(task: Task, single: Surroundings) -> list[Part]:
    """All tensors that the signals hold: those that grow with the batch are a sample's own."""
    batch = task.batch
    given = task.scenario.surroundings
    held = held_tensors(single)
    if not given.batch_shape:
        return [Part(name, as_rows(value, batch, None)) for name, value in held.items()]
    wider = held_tensors(given.expand((1, *batch)))
    parts = []
    for name, value in held.items():
        own = wider[name].dim() == value.dim() + 1
        parts.append(Part(name, as_rows(value, batch, value.dim() - len(batch) if own else None)))
    return parts
