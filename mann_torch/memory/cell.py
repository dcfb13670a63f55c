"""The working memory as a recurrent cell: `read, state = cell(x, state)`."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import torch
from torch import Tensor, nn

from ..constraints import DesignModule, Positive
from ..errors import ConfigError, DtypeError, ShapeError
from ..functional import Numbers
from ..types import MemoryOutput, MemoryState
from .attention import Attention
from .cell_state import Attended, CellState, check_state, state_of
from .keys import KeyRule
from .soft import SoftAttention
from .stepping import exponential_step
from .working_memory import WorkingMemory


class MemoryCell(DesignModule):
    """S slots of N numbers, read and written by attention, as a recurrent cell.

    One step with x (..., input_size), in the order of the paper's hybrid system:

    1. features sigma = features(x), by default sigmoid(V'x + b_v);
    2. jump: reallocating attention resets a slot where none is relevant;
    3. read h_o = sum_i w_r(i) mu_i (eq. memoryread), before x is written;
    4. write d mu_i/dt = w_r(i) (c_w sigma + W h_e' - mu_i) (eq. memorywrite) over `dt`, with w_r
       held: mu_i += (1 - exp(-w_r(i) dt)) (c_w sigma + W h_e' - mu_i), its exact solution, stable
       at any dt; the same for state keys. A key rule without `rate` takes Euler's step.

    It returns h_o (..., N), or with `output_size` the paper's W'(sigma + h_o) + b_w.

    `key_rule` as in `WorkingMemory`; state keys compare x, or `context_size` numbers that a linear
    layer makes of it. `features` replaces the first layer: any module (..., input_size) ->
    (..., hidden_size), made float64. `clock=True` lets a layer scale each step's dt by 2 sigmoid
    (c'x + b), between 0 and 2: time stands still for what is not to be written. Constants, frozen
    until `tune` names them: `dt`, `write_gain` (c_w), and those of attention and key rule. `slots`
    and `slot_keys`, learnable, are what a run starts from, unless `memory.store_` gave contents.

    Gradients flow through contents and, under soft and relaxed attention, through the weights.
    Hard and reallocating attention choose: through the choice there is none (`relaxed(cell, T)`
    gives the smooth form of the same cell).

    `dtype` is that of x and of what is returned (default: torch's), and `.float()` or
    `.to(dtype)` change just that. Inside, parameters and state are float64, always.

    Raises `ConfigError` or `DomainError` for a setting, `ShapeError` or `DtypeError` for a tensor
    that does not fit.

    >>> cell = MemoryCell(input_size=3, hidden_size=8, n_slots=4)
    >>> read, state = cell(torch.zeros(2, 3), cell.initial_state((2,)))
    >>> read.shape, read.dtype, state.mu.shape
    (torch.Size([2, 8]), torch.float32, torch.Size([2, 4, 8]))
    """

    def __init__(
        self,
        input_size: int,
        hidden_size: int,
        n_slots: int = 5,
        attention: Attention | None = None,
        key_rule: KeyRule | None = None,
        *,
        context_size: int | None = None,
        output_size: int | None = None,
        features: nn.Module | None = None,
        clock: bool = False,
        dt: Numbers = 1.0,
        write_gain: Numbers = 0.75,
        reset: str = "scaled",
        dtype: torch.dtype | None = None,
    ) -> None:
        super().__init__()
        for name, size in (
            ("input_size", input_size),
            ("context_size", 1 if context_size is None else context_size),
            ("output_size", 1 if output_size is None else output_size),
        ):
            if size < 1:
                raise ConfigError(f"{name} = {size}: must be at least 1")
        double = torch.float64
        self.input_size, self.hidden_size, self.n_slots = input_size, hidden_size, n_slots
        self.dtype = torch.get_default_dtype() if dtype is None else dtype
        if not self.dtype.is_floating_point:
            raise DtypeError(f"dtype = {self.dtype}: must be a floating-point dtype")
        attention = SoftAttention() if attention is None else attention
        width = input_size if context_size is None else context_size
        self.memory = WorkingMemory(
            n_slots, hidden_size, attention, key_rule, width, write_gain, reset
        )
        if features is None:
            features = nn.Sequential(nn.Linear(input_size, hidden_size), nn.Sigmoid())
        self.features = features.to(double)
        self.context: nn.Module = nn.Identity()
        if context_size is not None:
            self.context = nn.Linear(input_size, context_size, dtype=double)
        self.clock = nn.Linear(input_size, 1, dtype=double) if clock else None
        self.output = None
        if output_size is not None:
            self.output = nn.Linear(hidden_size, output_size, dtype=double)
        self.dt: Tensor
        self.declare("dt", dt, Positive())
        # Contents as c_w sigma has them, no two alike: equal slots would stay equal.
        gain = self.memory.write_gain.detach().mean()
        self.slots = nn.Parameter(gain * torch.rand(n_slots, hidden_size, dtype=double))
        self.slot_keys = nn.Parameter(torch.randn_like(self.memory.initial_keys))

    def initial_state(self, batch_shape: Sequence[int] | int = ()) -> CellState:
        """State before the first step: `slots` and `slot_keys`, or what `memory.store_` kept."""
        batch = (batch_shape,) if isinstance(batch_shape, int) else tuple(batch_shape)
        memory = self.memory
        mu = torch.where(memory.has_contents, memory.initial_mu, self.slots)
        keys = torch.where(memory.has_contents, memory.initial_keys, self.slot_keys)
        start = MemoryState(mu.expand(*batch, -1, -1), keys.expand(*batch, -1, -1))
        return state_of(start, memory.initial_mode(batch))

    def initial_state_at(self, x: Tensor) -> CellState:
        """The paper's start: every slot c_w sigma at the first x (..., I), with fresh keys."""
        hidden, context = self._look(x)
        return state_of(
            self.memory.initial_state(hidden, context), self.memory.initial_mode(x.shape[:-1])
        )

    def forward(
        self,
        x: Tensor,
        state: CellState,
        correction: Tensor | None = None,
        dt: Tensor | None = None,
    ) -> tuple[Tensor, CellState]:
        """Read h_o (..., N), or output (..., output_size), and the next state.

        x (..., input_size); `correction` is W h_e' (..., N), none if not given; `dt` (...,) >= 0
        replaces the constant for this step, for samples at uneven times. Leading dimensions
        broadcast.
        """
        seen = self.attend(x, state, dt)
        return self.output_of(seen), self.write(seen, correction)

    def attend(self, x: Tensor, state: CellState, dt: Tensor | None = None) -> Attended:
        """Jump and read, the first half of a step: for a correction that depends on the read."""
        hidden, context = self._look(x, state)
        memory, mode = self.memory.reallocate(hidden, context, state.memory, state.mode)
        out = self.memory(hidden, torch.zeros_like(hidden), context, memory, mode)
        after = state_of(memory, self.memory.note(out.weights, mode))
        span = self._pace(x) * (self.dt if dt is None else dt)
        return Attended(out.read, out.weights, hidden, context, out.d_memory, span, after)

    def write(self, seen: Attended, correction: Tensor | None = None) -> CellState:
        """The second half: the write law over dt with the weights held."""
        memory, change = seen.state.memory, seen.d_memory
        if correction is not None:
            mode = seen.state.mode._replace(held=seen.weights)
            bent = self._correction(correction)
            change = self.memory(seen.hidden, bent, seen.context, memory, mode).d_memory
        rate = self.memory.key_rule.rate(seen.weights)
        mu = exponential_step(memory.mu, change.mu, seen.weights, seen.dt)
        keys = exponential_step(memory.keys, change.keys, rate, seen.dt)
        return seen.state._replace(mu=mu, keys=keys)

    def output_of(self, seen: Attended) -> Tensor:
        """h_o (..., N), or W'(sigma + h_o) + b_w (..., output_size), in `dtype`."""
        out = seen.read if self.output is None else self.output(seen.hidden + seen.read)
        return out.to(self.dtype)

    def flow(self, x: Tensor, state: CellState, correction: Tensor | None = None) -> MemoryOutput:
        """Read, weights and d memory/dt at x (..., I), float64: the cell as a term of an ODE.

        Nothing jumps: put `jump` between the pieces that a solver integrates.
        """
        hidden, context = self._look(x, state)
        bent = torch.zeros_like(hidden) if correction is None else self._correction(correction)
        out = self.memory(hidden, bent, context, state.memory, state.mode)
        pace = self._pace(x).unsqueeze(-1).unsqueeze(-1)
        rates = MemoryState(pace * out.d_memory.mu, pace * out.d_memory.keys)
        return MemoryOutput(out.read, out.weights, rates)

    def d_memory(
        self, x: Tensor, state: CellState, correction: Tensor | None = None
    ) -> MemoryState:
        """d mu/dt (..., S, N) and d keys/dt (..., S, D), for a solver's right-hand side."""
        return self.flow(x, state, correction).d_memory

    def jump(self, x: Tensor, state: CellState) -> CellState:
        """Attention's decisions alone: reallocation, and which slot is attended now."""
        hidden, context = self._look(x, state)
        return state_of(*self.memory.jump(hidden, context, state.memory, state.mode))

    def _look(self, x: Tensor, state: CellState | None = None) -> tuple[Tensor, Tensor]:
        """The way in: features and context, float64, of an x and a state that fit."""
        if x.dtype != self.dtype:
            raise DtypeError(
                f"x is {x.dtype}, this cell takes {self.dtype}: convert x, or the cell with "
                f".to({x.dtype})"
            )
        if x.dim() < 1 or x.shape[-1] != self.input_size:
            raise ShapeError(f"x has shape {tuple(x.shape)}, not (..., {self.input_size})")
        if state is not None:
            check_state(x, state, self.slots.shape, self.slot_keys.shape)
        x = x.to(torch.float64)
        return self.features(x), self.context(x)

    def _correction(self, correction: Tensor) -> Tensor:
        if correction.dim() < 1 or correction.shape[-1] != self.hidden_size:
            raise ShapeError(
                f"correction has shape {tuple(correction.shape)}, not (..., {self.hidden_size})"
            )
        return correction.to(torch.float64)

    def _pace(self, x: Tensor) -> Tensor:
        if self.clock is None:
            return torch.ones_like(x[..., 0], dtype=torch.float64)
        return 2.0 * torch.sigmoid(self.clock(x.to(torch.float64)).squeeze(-1))

    def _apply(self, fn: Callable[[Tensor], Tensor], recurse: bool = True) -> Any:
        """`.float()` and `.to(dtype)` set what goes in and comes out; inside stays float64."""
        asked = {fn(torch.zeros((), dtype=kind)).dtype for kind in (torch.float32, torch.float64)}
        if len(asked) == 1:
            (self.dtype,) = asked

        def keep(tensor: Tensor) -> Tensor:
            moved = fn(tensor)
            return moved if moved.dtype == tensor.dtype else tensor.to(moved.device)

        return super()._apply(keep, recurse)
