"""Experiments of one controller side by side in one batch."""

from __future__ import annotations

from collections.abc import Sequence

import torch
from torch import Tensor

from mann_torch import Scenario
from mann_torch.types import NetworkState

from .build import Experiment


def side_by_side(
    parts: Sequence[Experiment],
) -> tuple[Scenario, NetworkState, dict[str, Tensor]]:
    """Scenarios (B,), initial weights (B, *event), and the constants that differ, (B, *event).

    Each part is an unbatched scenario with its draws; B counts all draws of all parts in order.
    """
    draws = [len(part.network.b_v) for part in parts]
    scenarios = [part.scenario for part, n in zip(parts, draws, strict=True) for _ in range(n)]
    network = NetworkState(
        *(torch.cat(leaf) for leaf in zip(*(part.network for part in parts), strict=True))
    )
    constants = [part.loop.controller.constants() for part in parts]
    own = {}
    for name in constants[0]:
        column = [constant[name].detach() for constant in constants]
        if any(not torch.equal(value, column[0]) for value in column):
            own[name] = torch.cat(
                [value.expand(n, *value.shape) for value, n in zip(column, draws, strict=True)]
            )
    return Scenario.stack(scenarios), network, own
