"""The step of a cell: what is made of x alone, then all that depends on the state."""

from __future__ import annotations

import torch
from torch import Tensor, nn

from ...constraints import DesignModule
from ...errors import DtypeError
from ...functional import one_hot
from ..checks import autocast_is_on, check_tensor, exactly
from ..working_memory import WorkingMemory
from .cell_state import Attended, CellState, Looked, even, state_of
from .inertia import Inertia
from .stepping import exponential_step, share_of
from .writing import moved_on


class CellStep(DesignModule):
    """A cell's parts and its equations; `MemoryCell` makes and checks them."""

    input_size: int
    hidden_size: int
    n_slots: int
    writing: str
    memory: WorkingMemory
    features: nn.Module  # (..., I) -> (..., N)
    context: nn.Module  # (..., I) -> (..., C)
    inertia: Inertia | None
    clock: nn.Linear | None  # (..., I) -> (..., 1)
    clock_feedback: nn.Linear | None  # (..., N) -> (..., 1), of features with inertia
    mix: nn.Linear | None  # (..., N) -> (..., N), of the read beside features with inertia
    output: nn.Linear | None  # (..., N) -> (..., output_size)
    slots: Tensor  # (S, N)
    slot_keys: Tensor  # (S, D)
    dt: Tensor

    @property
    def stepped(self) -> list[str]:
        """Names of the parts that a step goes through after `look`."""
        names = ["memory"]
        names += ["inertia"] if self.inertia is not None else []
        return names + (["clock_feedback"] if self.clock_feedback is not None else [])

    @property
    def dtype(self) -> torch.dtype:
        """What this cell computes in."""
        return self.slots.dtype

    def look(self, x: Tensor, dt: Tensor | None = None) -> Looked:
        """What a step makes of x (..., I) alone, for any number of steps at once.

        `dt` (...,) replaces the constant. Raises `ShapeError`, `DtypeError`.
        """
        check_tensor("x", x, (self.input_size,), None)
        loose = autocast_is_on(x.device)
        if x.dtype != self.dtype and not loose:
            raise DtypeError(
                f"x is {x.dtype}, this cell takes {self.dtype}: convert x, or the cell with "
                f".to({x.dtype})"
            )
        x = x.to(self.dtype)
        if dt is not None:
            check_tensor("dt", dt, (), self.dtype)
        span = self.dt if dt is None else dt
        pace = x[..., :0] if self.inertia is None else self.inertia.pace(x)
        clock = span if self.clock is None else self.clock(x).squeeze(-1)
        found = Looked(self.features(x), pace, self.context(x), clock, span)
        return Looked(*(leaf.to(self.dtype) for leaf in found)) if loose else found

    def seen(self, looked: Looked, state: CellState) -> tuple[Attended, CellState]:
        """One step of what was looked at: all that depends on the state.

        Nothing is checked: this is what a sequence compiles.
        """
        with exactly(looked.hidden.device):
            seen = self._attend(looked, state)
            return seen, self._write(seen, None)

    def shown(self, hidden: Tensor, read: Tensor) -> Tensor:
        """The output of features and read (..., N), for any number of steps at once."""
        together = read if self.mix is None else hidden + self.mix(read)
        if self.output is not None:
            together = self.output(together if self.mix is not None else hidden + read)
        return together.to(self.dtype)

    def _hidden(self, looked: Looked, state: CellState) -> Tensor:
        """sigma (..., N) of this step."""
        if self.inertia is None:
            return looked.hidden
        return self.inertia(looked.hidden, looked.pace, state.hidden)

    def _span(self, looked: Looked, hidden: Tensor) -> Tensor:
        """Memory's time (...,) that passes in this step: dt log(1 + exp(clock))."""
        if self.clock is None:
            return looked.dt
        clock = looked.clock
        if self.clock_feedback is not None:
            clock = clock + self.clock_feedback(hidden).squeeze(-1)
        return nn.functional.softplus(clock) * looked.dt

    def _attend(self, looked: Looked, state: CellState) -> Attended:
        memory, hidden = self.memory, self._hidden(looked, state)
        held, mode = memory.reallocate(hidden, looked.context, state.memory, state.mode)
        weights, read = memory.attend(hidden, looked.context, held, mode)
        own = hidden if self.inertia is not None else state.hidden
        after = state_of(held, memory.note(weights, mode), own, state.next)
        span = self._span(looked, hidden)
        return Attended(read, weights, hidden, looked.context, span, after)

    def _write(self, seen: Attended, correction: Tensor | None) -> CellState:
        held, rule, state = seen.state.memory, self.memory.key_rule, seen.state
        where, slot = seen.weights, state.next
        if self.writing == "next":
            where = one_hot(slot, self.n_slots).to(seen.weights.dtype)
            slot = moved_on(slot, -torch.expm1(-seen.dt), self.n_slots)
        share = share_of(where, seen.dt).unsqueeze(-1)
        mu = held.mu + share * self.memory.offset(seen.hidden, correction, held)
        keys = held.keys
        if keys.shape[-1]:
            change = rule.derivative(where, seen.context, held)
            keys = exponential_step(keys, change, rule.rate(where), seen.dt)
        return even(state._replace(mu=mu, keys=keys, next=slot))
