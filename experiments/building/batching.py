"""Experiments of one controller side by side in one batch."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import torch
from torch import Tensor

from mann_torch import Scenario
from mann_torch.trees import leaves, map_tensors

from .build import Experiment


def side_by_side(
    parts: Sequence[Experiment],
) -> tuple[Scenario, Any, dict[str, Tensor]]:
    """Scenarios (B,), initial weights (B, *event), and the constants that differ, (B, *event).

    Each part is an unbatched scenario with its draws; B counts all draws of all parts in order.
    """
    draws = [len(leaves(part.weights)[0]) for part in parts]
    scenarios = [part.scenario for part, n in zip(parts, draws, strict=True) for _ in range(n)]
    weights = map_tensors(lambda *leaf: torch.cat(leaf), *(part.weights for part in parts))
    constants = [part.loop.constants() for part in parts]
    own = {}
    for name in constants[0]:
        column = [constant[name].detach() for constant in constants]
        if any(not torch.equal(value, column[0]) for value in column):
            own[name] = torch.cat(
                [value.expand(n, *value.shape) for value, n in zip(column, draws, strict=True)]
            )
    return Scenario.stack(scenarios), weights, own
