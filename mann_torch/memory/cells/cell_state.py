"""What a cell carries from step to step, and what it sees on the way."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import torch
from torch import Tensor

from ...errors import KindError, ShapeError
from ...trees import portable
from ...types import MemoryMode, MemoryState
from ..checks import Sizes, check_tensor

#: Event dimensions of the leaves of a state, and of what is made of x.
RANKS = (1, 2, 2, 1, 0, 0, 0, 0)
LOOKED_RANKS = (1, 1, 1, 0, 0)


@portable
class CellState(NamedTuple):
    """All that a cell carries from one step to the next; nothing but tensors."""

    hidden: Tensor  # (..., N) features that have inertia; N = 0 if they have none
    mu: Tensor  # (..., S, N) slot contents
    keys: Tensor  # (..., S, D) keys with a motion of their own; D = 0 if there are none
    active: Tensor  # (..., S) bool, slots in use; relaxed attention: levels in [0, 1]
    attended: Tensor  # (...,) int64, slot with the largest weight; -1 before the first step
    switches: Tensor  # (...,) int64, changes of the attended slot so far
    reallocations: Tensor  # (...,) int64, resets so far
    next: Tensor  # (...,) int64, slot to be written, where they are written in turn

    @property
    def memory(self) -> MemoryState:
        """What flows: contents and keys."""
        return MemoryState(self.mu, self.keys)

    @property
    def mode(self) -> MemoryMode:
        """What jumps."""
        return MemoryMode(self.active, self.attended, self.switches, self.reallocations)

    def detach(self) -> CellState:
        """The same values, cut off from the graph: for truncated backpropagation."""
        return CellState(*(leaf.detach() for leaf in self))


class Looked(NamedTuple):
    """What a step takes of its x alone."""

    hidden: Tensor  # (..., N) sigma; with inertia, what it is drawn to
    pace: Tensor  # (..., N) how fast, before what the features themselves add; or (..., 0)
    context: Tensor  # (..., C) what state keys compare
    clock: Tensor  # (...,) how fast memory's time runs, likewise; not read without a clock
    dt: Tensor  # (...,) the step


class Attended(NamedTuple):
    """A look at the memory, and what writing to it needs."""

    read: Tensor  # (..., N) h_o
    weights: Tensor  # (..., S) w_r
    hidden: Tensor  # (..., N) sigma
    context: Tensor  # (..., C) what state keys compare
    dt: Tensor  # (...,) the step
    state: CellState  # after the jump, before the step


def state_of(
    memory: MemoryState, mode: MemoryMode, hidden: Tensor | None = None, slot: Tensor | None = None
) -> CellState:
    """Memory and mode as one flat state, all leaves of one batch shape."""
    hidden = memory.mu[..., 0, :0] if hidden is None else hidden
    slot = torch.zeros_like(mode.attended) if slot is None else slot
    return even(CellState(hidden, *memory, *mode[:4], slot))


def even(state: CellState) -> CellState:
    """Every leaf with the same batch shape: that of all together."""
    shapes = [leaf.shape[: leaf.dim() - rank] for leaf, rank in zip(state, RANKS, strict=True)]
    if all(shape == shapes[0] for shape in shapes):
        return state
    batch = torch.broadcast_shapes(*shapes)
    return CellState(
        *(
            leaf.expand(*batch, *leaf.shape[leaf.dim() - rank :])
            for leaf, rank in zip(state, RANKS, strict=True)
        )
    )


def check_state(
    state: CellState, tails: Sequence[Sizes], graded: bool, dtype: torch.dtype
) -> Sizes:
    """Batch shape of a state whose leaves end in `tails`, in their order, numbers in `dtype`.

    Raises `KindError` for what is no state, `ShapeError`, `DtypeError` for a leaf that does not
    fit.
    """
    if not isinstance(state, CellState):
        raise KindError(f"state is {type(state).__name__}, not CellState: use initial_state")
    count = torch.int64
    dtypes = (dtype, dtype, dtype, dtype if graded else torch.bool, *(count,) * 4)
    batch: Sizes | None = None
    for name, leaf, tail, kind in zip(state._fields, state, tails, dtypes, strict=True):
        found = check_tensor(f"state.{name}", leaf, tail, kind)
        if batch is not None and found != batch:
            raise ShapeError(f"batch shapes do not fit: state.mu {batch}, state.{name} {found}")
        batch = found
    return batch or ()
