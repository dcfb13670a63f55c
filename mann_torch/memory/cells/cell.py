"""The working memory as a recurrent cell: `output, state = cell(x, state)`."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Self

import torch
from torch import Tensor, nn

from ...checks import choice, flag, instance, sizes, whole
from ...constraints import Positive, follow_dtype
from ...errors import ConfigError, DtypeError
from ...functional import Numbers
from ...types import MemoryState
from ..attention.attention import Attention
from ..attention.soft import SoftAttention
from ..checks import Sizes, check_tensor, common_batch, exactly
from ..keys import KeyRule, RepresentationKeys, StateKeys, key_rule_of
from ..working_memory import WorkingMemory
from .cell_flow import CellFlow
from .cell_state import Attended, CellState, state_of
from .directions import Directions
from .inertia import Inertia
from .writing import WRITINGS


class MemoryCell(CellFlow):
    """S slots of N numbers, read and written by attention, as a recurrent cell.

    One step with x (..., input_size):

    1. features: with `inertia` sigma follows tanh(V'x + b_v + U sigma) over learned time constants
       (`Inertia`), without it is sigmoid(V'x + b_v);
    2. jump: reallocating attention resets a slot where none is relevant;
    3. read h_o = sum_i w_r(i) mu_i (paper, eq. memoryread), before x is written;
    4. write d mu_i/dt = w(i) (c_w sigma + W h_e' - mu_i) (eq. memorywrite) over `dt`, with w held:
       mu_i += (1 - exp(-w(i) dt)) (c_w sigma + W h_e' - mu_i), its exact solution, stable at any
       dt; the same for state keys. A key rule without `rate` takes Euler's step. `writing` says
       what w is: ``attended``, w_r itself, as in the paper; ``next``, one slot after the other, the
       next one's turn once more than half of a slot has been written.

    `clock=True` lets memory's time run by log(1 + exp(c'x + d'sigma + b)): a step of dt = 1 then
    writes the share sigmoid(c'x + d'sigma + b) of a slot, and time stands still for what is not to
    be kept. Output: sigma + M h_o (..., N) with inertia, h_o without; with `output_size` a linear
    layer of it, or W'(sigma + h_o) + b_w, what the paper's network estimates (its control signal
    u_ad, eq. nnoutput, is minus this).

    The defaults learn what `nn.LSTM` learns and what it does not (docs/memory.md); `paper` gives
    the paper's law. `key_rule` as in `WorkingMemory`, by default state keys, which compare x, or
    `context_size` numbers that a linear layer makes of it, of them the direction alone with
    `directions`. `features` replaces the first layer: any module
    (..., input_size) -> (..., hidden_size), with inertia what is inside the tanh.

    Constants, frozen until `tune` names them: `dt` (in units of the write law's time constant, 1 s
    in the paper), `write_gain` (c_w [-]), and those of attention and key rule. `slots` and
    `slot_keys`, learnable, are what a run starts from, unless `memory.store_` gave contents.

    Gradients flow through contents and, under soft and relaxed attention, through the weights.
    Hard and reallocating attention choose: through the choice there is none (`relaxed(cell, T)`
    gives the smooth form of the same cell); nor is there through whose turn it is.

    `dtype` is that of x, of parameters and state, and of the arithmetic (default: torch's);
    `.float()`, `.double()` and `.to(dtype)` change it.

    Raises `ConfigError` or `DomainError` for a setting, `ShapeError` or `DtypeError` for a tensor
    that does not fit.

    >>> cell = MemoryCell(input_size=3, hidden_size=8)
    >>> output, state = cell(torch.zeros(2, 3), cell.initial_state((2,)))
    >>> output.shape, output.dtype, state.mu.shape
    (torch.Size([2, 8]), torch.float32, torch.Size([2, 8, 8]))
    """

    def __init__(
        self,
        input_size: int,
        hidden_size: int,
        n_slots: int = 8,
        attention: Attention | None = None,
        key_rule: KeyRule | None = None,
        *,
        context_size: int | None = 16,
        directions: bool = True,
        output_size: int | None = None,
        features: nn.Module | None = None,
        inertia: bool = True,
        clock: bool = True,
        writing: str | None = None,
        dt: Numbers = 1.0,
        write_gain: Numbers = 1.0,
        reset: str = "scaled",
        dtype: torch.dtype | None = None,
    ) -> None:
        super().__init__()
        self.input_size = input_size = whole("input_size", input_size)
        self.hidden_size = hidden_size = whole("hidden_size", hidden_size)
        self.n_slots = n_slots = whole("n_slots", n_slots)
        dtype = torch.get_default_dtype() if dtype is None else dtype
        if not isinstance(dtype, torch.dtype) or not dtype.is_floating_point:
            raise DtypeError(f"dtype = {dtype}: must be a floating-point torch.dtype")
        attention = SoftAttention() if attention is None else attention
        key_rule = StateKeys() if key_rule is None else key_rule
        width = self._make_context(
            key_rule_of(key_rule), context_size, flag("directions", directions)
        )
        self.memory = WorkingMemory(
            n_slots, hidden_size, attention, key_rule, width, write_gain, reset
        )
        in_turn = "attended" if attention.reallocates else "next"
        self.writing = in_turn if writing is None else choice("writing", writing, WRITINGS)
        if self.writing == "next" and attention.reallocates:
            raise ConfigError("reallocating attention chooses what it writes: writing='attended'")
        self.inertia = Inertia(input_size, hidden_size) if flag("inertia", inertia) else None
        if features is None:
            features = nn.Linear(input_size, hidden_size)
            if self.inertia is not None:
                self.inertia.begin(features.weight)
            else:
                features = nn.Sequential(features, nn.Sigmoid())
        self.features = instance("features", features, nn.Module)
        self.clock = nn.Linear(input_size, 1) if flag("clock", clock) else None
        if self.clock is not None:
            nn.init.ones_(self.clock.bias)  # what comes is written, until it is learned what not to
        fed_back = clock and inertia
        self.clock_feedback = nn.Linear(hidden_size, 1, bias=False) if fed_back else None
        self.mix = nn.Linear(hidden_size, hidden_size, bias=False) if inertia else None
        self.output = None
        if output_size is not None:
            self.output = nn.Linear(hidden_size, whole("output_size", output_size))
        self.dt: Tensor
        self.declare("dt", dt, Positive())
        self._make_contents()
        follow_dtype(self)
        self.to(dtype)

    @classmethod
    def paper(
        cls,
        input_size: int,
        hidden_size: int,
        n_slots: int = 5,
        attention: Attention | None = None,
        key_rule: KeyRule | None = None,
        **options: Any,
    ) -> Self:
        """The paper's memory: no inertia, no clock, written where it is read, c_w = 0.75.

        Keys are the contents, unless another rule is given. `options` as the class takes them.

        >>> MemoryCell.paper(3, 8).initial_state().mu.shape
        torch.Size([5, 8])
        """
        key_rule = RepresentationKeys() if key_rule is None else key_rule
        theirs: dict[str, Any] = {"inertia": False, "clock": False, "writing": "attended"}
        theirs |= {"context_size": None, "directions": False, "write_gain": 0.75, **options}
        return cls(input_size, hidden_size, n_slots, attention, key_rule, **theirs)

    def _make_context(self, key_rule: KeyRule, context_size: int | None, directions: bool) -> int:
        """What keys are compared with, and its width."""
        self.context = nn.Identity()
        width = self.input_size if context_size is None else whole("context_size", context_size)
        if context_size is None or not key_rule.compares_context:
            return self.input_size
        kind = Directions if directions else nn.Linear
        self.context = kind(self.input_size, width)
        return width

    def _make_contents(self) -> None:
        """What a run starts from: nothing, or where slots are chosen by contents no two alike."""
        keys = self.memory.initial_keys
        shape, gain = (self.n_slots, self.hidden_size), self.memory.write_gain.detach().mean()
        in_turn = self.writing == "next"
        mu = gain * torch.rand(shape, dtype=torch.float64)
        self.slots = nn.Parameter(torch.zeros_like(mu) if in_turn else mu)
        self.slot_keys = nn.Parameter((0.1 if in_turn else 1.0) * torch.randn_like(keys))

    def initial_state(self, batch_shape: Sequence[int] | int = ()) -> CellState:
        """State before the first step: `slots` and `slot_keys`, or what `memory.store_` kept."""
        memory, shape = self.memory, sizes("batch_shape", batch_shape)
        batch = common_batch({"batch_shape": shape, "constants": tuple(self.batch_shape())})
        mu = torch.where(memory.has_contents, memory.initial_mu, self.slots)
        keys = torch.where(memory.has_contents, memory.initial_keys, self.slot_keys)
        start = MemoryState(mu.expand(*batch, -1, -1), keys.expand(*batch, -1, -1))
        return state_of(start, memory.initial_mode(batch), self._first(batch))

    def _first(self, batch: Sizes) -> Tensor:
        """Features with inertia before the first step (*batch, N), or (*batch, 0)."""
        first = self.slots[0, :0] if self.inertia is None else self.inertia.first
        return first.expand(*batch, -1)

    def initial_state_at(self, x: Tensor) -> CellState:
        """The paper's start: every slot c_w sigma at the first x (..., I), with fresh keys."""
        looked, batch = self.look(x), tuple(x.shape[:-1])
        first = self._first(batch)
        mode = self.memory.initial_mode(batch)
        hidden = self._hidden(looked, self.initial_state(batch))
        return state_of(self.memory.initial_state(hidden, looked.context), mode, first)

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

    def attend(self, x: Tensor, state: CellState, dt: Tensor | float | None = None) -> Attended:
        """Jump and read, the first half of a step: for a correction that depends on the read.

        Raises as `forward`.
        """
        batch = self._batch(x, state)
        looked = self.look(x, None if dt is None else self._length(dt, batch))
        with exactly(x.device):
            return self._attend(looked, state)

    def write(self, seen: Attended, correction: Tensor | None = None) -> CellState:
        """The second half: the write law over dt with the weights held. Raises as `forward`."""
        instance("seen", seen, Attended)
        if correction is not None:
            self._check_correction(correction, tuple(seen.weights.shape[:-1]))
        with exactly(seen.hidden.device):
            return self._write(seen, correction)

    def output_of(self, seen: Attended) -> Tensor:
        """h_o (..., N), or W'(sigma + h_o) + b_w (..., output_size). Raises `KindError`."""
        instance("seen", seen, Attended)
        return self.shown(seen.hidden, seen.read)
