"""What is marched, and over what."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import torch
from torch import Tensor

from .packing import lanes_for
from .program import Program


@dataclass(frozen=True)
class Job:
    """One march of a program, apart from what gradients reach.

    Kept rows: `motion_slot` and `state_slot` (T+1,) int32 name the row a step time is kept in, -1
    for none.
    """

    program: Program
    clock: Tensor  # (T, C); floating tensors are of the program's dtype
    segment_of: Tensor  # (T,) int32, row of the segments in force in a step
    noise: tuple[Tensor, Tensor, Tensor] | None  # table (R, K, W), row (B,), instant (T,) int32
    whole: Tensor  # (B, N) int64, constants that are integers or masks; a mask is 0 or -1
    carry_k: Tensor  # (B, K) int64, the same
    motion_slot: Tensor
    state_slot: Tensor
    limit: float
    tape_memory: float  # [bytes]
    wanted: tuple[tuple[int, ...], tuple[int, ...]]  # constants, segments with gradients
    progress: Callable[[int], object] | None = None
    lanes: int | None = None  # None: as many as serve the batch
    device: str = "cpu"

    @property
    def lanes_used(self) -> int:
        """Lanes of a group."""
        threads = torch.get_num_threads()
        return self.lanes or lanes_for(self.program, len(self.carry_k), threads, self.device)

    @property
    def n_steps(self) -> int:
        """T."""
        return len(self.clock)
