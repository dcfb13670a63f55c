"""The working memory as a recurrent cell: `read, state = cell(x, state)`."""

from __future__ import annotations

from collections.abc import Sequence
from typing import cast

import torch
from torch import Tensor, nn

from ..checks import flag, instance, sizes, whole
from ..constraints import DesignModule, Positive, follow_dtype
from ..errors import DtypeError
from ..functional import Numbers
from ..types import MemoryOutput, MemoryState
from .attention import Attention
from .cell_state import Attended, CellState, Looked, check_state, even, state_of
from .checks import Sizes, autocast_is_on, check_tensor, check_within, common_batch
from .keys import KeyRule
from .soft import SoftAttention
from .stepping import exponential_step, share_of
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

    It returns h_o (..., N), or with `output_size` W'(sigma + h_o) + b_w, what the paper's network
    estimates (its control signal u_ad, eq. nnoutput, is minus this).

    `key_rule` as in `WorkingMemory`; state keys compare x, or `context_size` numbers that a linear
    layer makes of it. `features` replaces the first layer: any module (..., input_size) ->
    (..., hidden_size), made float64. `clock=True` lets a layer scale each step's dt by 2 sigmoid
    (c'x + b), between 0 and 2: time stands still for what is not to be written. Constants, frozen
    until `tune` names them: `dt` (in units of the write law's time constant, 1 s in the paper),
    `write_gain` (c_w [-]), and those of attention and key rule. `slots` and `slot_keys`, learnable,
    are what a run starts from, unless `memory.store_` gave contents.

    Gradients flow through contents and, under soft and relaxed attention, through the weights.
    Hard and reallocating attention choose: through the choice there is none (`relaxed(cell, T)`
    gives the smooth form of the same cell).

    `dtype` is that of x, of parameters and state, and of the arithmetic (default: torch's);
    `.float()`, `.double()` and `.to(dtype)` change it.

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
        input_size = whole("input_size", input_size)
        hidden_size, n_slots = whole("hidden_size", hidden_size), whole("n_slots", n_slots)
        context_size = None if context_size is None else whole("context_size", context_size)
        output_size = None if output_size is None else whole("output_size", output_size)
        self.input_size, self.hidden_size, self.n_slots = input_size, hidden_size, n_slots
        dtype = torch.get_default_dtype() if dtype is None else dtype
        if not isinstance(dtype, torch.dtype) or not dtype.is_floating_point:
            raise DtypeError(f"dtype = {dtype}: must be a floating-point torch.dtype")
        attention = SoftAttention() if attention is None else attention
        width = input_size if context_size is None else context_size
        self.memory = WorkingMemory(
            n_slots, hidden_size, attention, key_rule, width, write_gain, reset
        )
        if features is None:
            features = nn.Sequential(nn.Linear(input_size, hidden_size), nn.Sigmoid())
        self.features = instance("features", features, nn.Module)
        self.context: nn.Module = nn.Identity()
        if context_size is not None:
            self.context = nn.Linear(input_size, context_size)
        self.clock = nn.Linear(input_size, 1) if flag("clock", clock) else None
        self.output = None
        if output_size is not None:
            self.output = nn.Linear(hidden_size, output_size)
        self.dt: Tensor
        self.declare("dt", dt, Positive())
        # Contents as c_w sigma has them, no two alike: equal slots would stay equal.
        gain = self.memory.write_gain.detach().mean()
        self.slots = nn.Parameter(gain * torch.rand(n_slots, hidden_size, dtype=torch.float64))
        self.slot_keys = nn.Parameter(torch.randn_like(self.memory.initial_keys))
        follow_dtype(self)
        self.to(dtype)

    @property
    def dtype(self) -> torch.dtype:
        """What this cell computes in."""
        return self.slots.dtype

    def initial_state(self, batch_shape: Sequence[int] | int = ()) -> CellState:
        """State before the first step: `slots` and `slot_keys`, or what `memory.store_` kept."""
        memory, shape = self.memory, sizes("batch_shape", batch_shape)
        batch = common_batch({"batch_shape": shape, "constants": tuple(self.batch_shape())})
        mu = torch.where(memory.has_contents, memory.initial_mu, self.slots)
        keys = torch.where(memory.has_contents, memory.initial_keys, self.slot_keys)
        start = MemoryState(mu.expand(*batch, -1, -1), keys.expand(*batch, -1, -1))
        return state_of(start, memory.initial_mode(batch))

    def initial_state_at(self, x: Tensor) -> CellState:
        """The paper's start: every slot c_w sigma at the first x (..., I), with fresh keys."""
        hidden, context, _ = self.look(x)
        return state_of(
            self.memory.initial_state(hidden, context), self.memory.initial_mode(x.shape[:-1])
        )

    def forward(
        self,
        x: Tensor,
        state: CellState | None = None,
        correction: Tensor | None = None,
        dt: Tensor | float | None = None,
    ) -> tuple[Tensor, CellState]:
        """Read h_o (..., N), or output (..., output_size), and the next state.

        x (..., input_size); without a `state`, `initial_state`; `correction` is W h_e' (..., N),
        none if not given; `dt` (...,) >= 0, in the constant's unit, replaces it for this step, for
        samples at uneven times (its sign is not checked). Leading dimensions of x and state
        broadcast, and those of the others to them.

        Raises `ShapeError`, `DtypeError`, or `ConfigError` for a state of another kind.
        """
        if state is None:
            state = self.initial_state(check_tensor("x", x, (self.input_size,), None))
        seen = self.attend(x, state, dt)
        return self.output_of(seen), self.write(seen, correction)

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
        span = self.dt if dt is None else dt
        if self.clock is not None:
            span = 2.0 * torch.sigmoid(self.clock(x).squeeze(-1)) * span
        found = Looked(self.features(x), self.context(x), span)
        return Looked(*(leaf.to(self.dtype) for leaf in found)) if loose else found

    def seen(self, looked: Looked, state: CellState) -> tuple[Attended, CellState]:
        """One step of what was looked at: all that depends on the state.

        Nothing is checked: this is what a sequence compiles.
        """
        seen = self._attend(looked, state)
        return seen, self._write(seen, None)

    def attend(self, x: Tensor, state: CellState, dt: Tensor | float | None = None) -> Attended:
        """Jump and read, the first half of a step: for a correction that depends on the read.

        Raises as `forward`.
        """
        batch = self._batch(x, state)
        return self._attend(self.look(x, None if dt is None else self._span(dt, batch)), state)

    def _attend(self, looked: Looked, state: CellState) -> Attended:
        memory, (hidden, context, span) = self.memory, looked
        held, mode = memory.reallocate(hidden, context, state.memory, state.mode)
        weights, read = memory.attend(hidden, context, held, mode)
        after = state_of(held, memory.note(weights, mode))
        return Attended(read, weights, hidden, context, span, after)

    def write(self, seen: Attended, correction: Tensor | None = None) -> CellState:
        """The second half: the write law over dt with the weights held. Raises as `forward`."""
        instance("seen", seen, Attended)
        if correction is not None:
            self._check_correction(correction, tuple(seen.weights.shape[:-1]))
        return self._write(seen, correction)

    def _write(self, seen: Attended, correction: Tensor | None) -> CellState:
        held, rule, weights = seen.state.memory, self.memory.key_rule, seen.weights
        share = share_of(weights, seen.dt).unsqueeze(-1)
        mu = held.mu + share * self.memory.offset(seen.hidden, correction, held)
        keys = held.keys
        if keys.shape[-1]:
            change = rule.derivative(weights, seen.context, held)
            keys = exponential_step(keys, change, rule.rate(weights), seen.dt)
        return even(seen.state._replace(mu=mu, keys=keys))

    def output_of(self, seen: Attended) -> Tensor:
        """h_o (..., N), or W'(sigma + h_o) + b_w (..., output_size). Raises `KindError`."""
        instance("seen", seen, Attended)
        return self.shown(seen.hidden, seen.read)

    def shown(self, hidden: Tensor, read: Tensor) -> Tensor:
        """The output of features and read (..., N), for any number of steps at once."""
        found = read if self.output is None else self.output(hidden + read)
        return found.to(self.dtype)

    def flow(self, x: Tensor, state: CellState, correction: Tensor | None = None) -> MemoryOutput:
        """Read, weights and d memory/dt at x (..., I): the cell as a term of an ODE.

        Nothing jumps: put `jump` between the pieces that a solver integrates. Raises as `forward`.
        """
        batch = self._batch(x, state)
        # The clock scales time: rates are those of a step of unit length.
        hidden, context, pace = self.look(x, torch.ones_like(self.slots[0, 0]))
        bent = torch.zeros_like(hidden)
        if correction is not None:
            self._check_correction(correction, batch)
            bent = correction
        out = self.memory(hidden, bent, context, state.memory, state.mode)
        scale = pace.unsqueeze(-1).unsqueeze(-1)
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
        hidden, context, _ = self.look(x)
        return state_of(*self.memory.jump(hidden, context, state.memory, state.mode))

    def check_state(self, state: CellState) -> Sizes:
        """Batch shape of a state of this cell. Raises `KindError`, `ShapeError`, `DtypeError`."""
        tails = (tuple(self.slots.shape), tuple(self.slot_keys.shape), (self.n_slots,), (), (), ())
        return check_state(state, tails, self.memory.attention.graded, self.dtype)

    def _batch(self, x: Tensor, state: CellState) -> Sizes:
        """The batch shape of x and state together, both checked."""
        shape = check_tensor("x", x, (self.input_size,), None)
        return common_batch({"x": shape, "state": self.check_state(state)})

    def _span(self, dt: Tensor | float, batch: Sizes) -> Tensor:
        if isinstance(dt, int | float) and not isinstance(dt, bool):
            dt = torch.as_tensor(dt, dtype=self.dtype)
        span = cast(Tensor, dt)  # as is checked next
        check_within("dt", check_tensor("dt", span, (), None), batch)
        return span.to(self.slots)

    def _check_correction(self, correction: Tensor, batch: Sizes) -> None:
        found = check_tensor("correction", correction, (self.hidden_size,), self.dtype)
        check_within("correction", found, batch)
