"""What a cell carries from step to step, and what it sees on the way."""

from __future__ import annotations

from typing import NamedTuple

import torch
from torch import Tensor

from ..errors import ConfigError, DtypeError, ShapeError
from ..types import MemoryMode, MemoryState


class CellState(NamedTuple):
    """All that a cell carries from one step to the next; nothing but tensors."""

    mu: Tensor  # (..., S, N) float64, slot contents
    keys: Tensor  # (..., S, D) float64, keys with a motion of their own; D = 0 if there are none
    active: Tensor  # (..., S) bool, slots in use; relaxed attention: float64 levels in [0, 1]
    attended: Tensor  # (...,) int64, slot with the largest weight; -1 before the first step
    switches: Tensor  # (...,) int64, changes of the attended slot so far
    reallocations: Tensor  # (...,) int64, resets so far

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


class Attended(NamedTuple):
    """A look at the memory, and what writing to it needs."""

    read: Tensor  # (..., N) float64, h_o
    weights: Tensor  # (..., S) float64, w_r
    hidden: Tensor  # (..., N) float64, sigma
    context: Tensor  # (..., C) float64, what state keys compare
    d_memory: MemoryState  # time derivative without a correction
    dt: Tensor  # (...,) the step
    state: CellState  # after the jump, before the step


def state_of(memory: MemoryState, mode: MemoryMode) -> CellState:
    """Memory and mode as one flat state."""
    return CellState(*memory, *mode[:4])


def check_state(x: Tensor, state: CellState, mu: torch.Size, keys: torch.Size) -> None:
    """Raise for a state that does not fit x (..., I) and contents (S, N) with keys (S, D)."""
    if not isinstance(state, CellState):
        raise ConfigError(f"state is {type(state).__name__}, not CellState: use initial_state")
    if state.mu.dtype != torch.float64 or state.keys.dtype != torch.float64:
        raise DtypeError(f"state is {state.mu.dtype}; a cell's state is always float64")
    for name, leaf, tail in (("mu", state.mu, mu), ("keys", state.keys, keys)):
        if leaf.shape[-2:] != tail:
            raise ShapeError(
                f"state.{name} has shape {tuple(leaf.shape)}, not (..., {tuple(tail)})"
            )
    batches = x.shape[:-1], state.mu.shape[:-2]
    if any(a != b and 1 not in (a, b) for a, b in zip(*map(reversed, batches), strict=False)):
        raise ShapeError(f"batch shapes of x and state do not fit: {batches}")
