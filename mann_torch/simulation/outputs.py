"""What a plant's outputs were, from its recorded states."""

from __future__ import annotations

import itertools
from typing import Any

import torch
from torch import Tensor

from ..trees import Packer, map_tensors
from .task import Task


def plant_states(task: Task, rows: Tensor) -> Any:
    """Recorded numbers (T', ..., M) as the plant's state."""
    packer: Packer[Any] = Packer(task.state.plant, len(task.batch))
    return packer.unpack(rows)


def outputs_of(task: Task, times: Tensor, rows: Tensor) -> Tensor:
    """Outputs (T', ..., p) at step times (T',) [s] of recorded states (T', ..., M).

    Segment by segment: parameters are constant in one, and are not written out for each row.
    """
    states, segments = plant_states(task, rows), task.grid.segments
    firsts = torch.tensor([part.first for part in segments])
    edges = [0, *torch.searchsorted(times, task.grid.times[firsts[1:]]).tolist(), len(times)]
    found = []
    for number, (first, last) in enumerate(itertools.pairwise(edges)):
        if last > first:
            here = map_tensors(lambda x, a=first, b=last: x[a:b], states)
            found.append(task.loop.plant.output(here, task.coefficients(number)))
    return found[0] if len(found) == 1 else torch.cat(found)
