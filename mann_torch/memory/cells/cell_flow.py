"""The cell as a term of an ODE, and the checks of what its methods are given."""

from __future__ import annotations

from typing import cast

import torch
from torch import Tensor

from ...errors import ConfigError
from ...types import MemoryOutput, MemoryState
from ..checks import Sizes, check_tensor, check_within, common_batch
from .cell_state import CellState, check_state, state_of
from .cell_step import CellStep


class CellFlow(CellStep):
    """What a solver integrates, between jumps: of the paper's law alone."""

    def flow(self, x: Tensor, state: CellState, correction: Tensor | None = None) -> MemoryOutput:
        """Read, weights and d memory/dt at x (..., I): the cell as a term of an ODE.

        Nothing jumps: put `jump` between the pieces that a solver integrates. Raises as `forward`.
        """
        batch = self._batch(x, state)
        self._check_flows()
        # The clock scales time: rates are those of a step of unit length.
        looked = self.look(x, torch.ones_like(self.slots[0, 0]))
        hidden, context = looked.hidden, looked.context
        bent = torch.zeros_like(hidden)
        if correction is not None:
            self._check_correction(correction, batch)
            bent = correction
        out = self.memory(hidden, bent, context, state.memory, state.mode)
        scale = self._span(looked, hidden).unsqueeze(-1).unsqueeze(-1)
        rates = MemoryState(scale * out.d_memory.mu, scale * out.d_memory.keys)
        return MemoryOutput(out.read, out.weights, rates)

    def d_memory(
        self, x: Tensor, state: CellState, correction: Tensor | None = None
    ) -> MemoryState:
        """d mu/dt (..., S, N) and d keys/dt (..., S, D), for a solver's right-hand side."""
        return self.flow(x, state, correction).d_memory

    def jump(self, x: Tensor, state: CellState) -> CellState:
        """Attention's decisions alone: reallocation, and which slot is attended now.

        Raises as `forward`.
        """
        self._batch(x, state)
        self._check_flows()
        looked = self.look(x)
        found = self.memory.jump(looked.hidden, looked.context, state.memory, state.mode)
        return state_of(*found, state.hidden, state.next)

    def _check_flows(self) -> None:
        if self.inertia is not None or self.writing == "next":
            raise ConfigError(
                "features with inertia and slots in turn go by steps; the term of an ODE is that "
                "of the paper's law: MemoryCell.paper, or inertia=False and writing='attended'"
            )

    def check_state(self, state: CellState) -> Sizes:
        """Batch shape of a state of this cell. Raises `KindError`, `ShapeError`, `DtypeError`."""
        hidden = 0 if self.inertia is None else self.hidden_size
        shapes = tuple(self.slots.shape), tuple(self.slot_keys.shape)
        tails = ((hidden,), *shapes, (self.n_slots,), (), (), (), ())
        return check_state(state, tails, self.memory.attention.graded, self.dtype)

    def _batch(self, x: Tensor, state: CellState) -> Sizes:
        """The batch shape of x and state together, both checked."""
        shape = check_tensor("x", x, (self.input_size,), None)
        return common_batch({"x": shape, "state": self.check_state(state)})

    def _length(self, dt: Tensor | float, batch: Sizes) -> Tensor:
        if isinstance(dt, int | float) and not isinstance(dt, bool):
            dt = torch.as_tensor(dt, dtype=self.dtype)
        span = cast(Tensor, dt)  # as is checked next
        check_within("dt", check_tensor("dt", span, (), None), batch)
        return span.to(self.slots)

    def _check_correction(self, correction: Tensor, batch: Sizes) -> None:
        found = check_tensor("correction", correction, (self.hidden_size,), self.dtype)
        check_within("correction", found, batch)
