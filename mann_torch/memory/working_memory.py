"""The working memory: contents, write law, read, and the reset of a slot."""

from __future__ import annotations

from collections.abc import Sequence
from typing import cast

import torch
from torch import Tensor

from ..checks import choice, instance, sizes, whole
from ..constraints import DesignModule, Positive
from ..errors import ConfigError, ShapeError
from ..functional import Numbers, blend, frobenius, infinity_distances, per_matrix, row_times
from ..types import MemoryMode, MemoryOutput, MemoryState, Proximity
from .attention.attention import Attention, attention_of
from .checks import Row, check_together
from .keys import KeyRule, RepresentationKeys, key_rule_of

RESETS = ("scaled", "raw")


class WorkingMemory(DesignModule):
    """S slots of N numbers, written and read by attention.

    Write law (paper, eq. memorywrite), with w = w_r(i), sigma the hidden features and W h_e' the
    correction: d mu_i/dt = -w mu_i + c_w w sigma + w W h_e'. Read (eq. memoryread):
    h_o = sum_i w_r(i) mu_i.

    `write_gain` is c_w [-]. `reset` names what a reallocation writes: ``scaled`` = c_w sigma, the
    write law's fixed point, or ``raw`` = sigma. `context_width` is the width of what state keys
    compare (the arm's n joint positions).

    The buffers `initial_mu` (S, N), `initial_keys` (S, D) and `initial_active` (S,) hold what to
    start from once `store_` has filled them; before that every slot starts as c_w sigma at t = 0.

    Raises `ConfigError` for fewer than one slot or neuron or an unknown reset, `KindError` for a
    part that is no attention or key rule.
    """

    def __init__(
        self,
        n_slots: int,
        n_hidden: int,
        attention: Attention,
        key_rule: KeyRule | None = None,
        context_width: int = 0,
        write_gain: Numbers = 0.75,
        reset: str = "scaled",
    ) -> None:
        super().__init__()
        n_slots, n_hidden = whole("n_slots", n_slots), whole("n_hidden", n_hidden)
        key_rule = RepresentationKeys() if key_rule is None else key_rule
        self.n_slots, self.n_hidden = n_slots, n_hidden
        self.context_width = context_width = whole("context_width", context_width, least=0)
        self.reset = choice("reset", reset, RESETS)
        self.attention = attention_of(attention)
        self.key_rule = key_rule_of(key_rule)
        self.write_gain: Tensor
        self.declare("write_gain", write_gain, Positive())
        self.initial_mu: Tensor
        self.initial_keys: Tensor
        self.initial_active: Tensor
        self.has_contents: Tensor
        width = self.key_rule.width(context_width)
        for name, size in (("initial_mu", n_hidden), ("initial_keys", width)):
            self.register_buffer(name, torch.zeros(n_slots, size, dtype=torch.float64))
        self.register_buffer("initial_active", torch.ones(n_slots, dtype=torch.bool))
        self.register_buffer("has_contents", torch.tensor(False))

    def initial_state(self, hidden: Tensor, context: Tensor) -> MemoryState:
        """Memory at t = 0 for features (..., N) and context (..., C).

        Each slot c_w sigma with a fresh key, or what is stored. Raises `ShapeError`, `DtypeError`.
        """
        self._check(hidden, context)
        fixed_point = (self.write_gain.unsqueeze(-1) * hidden).unsqueeze(-2)
        fresh = self.key_rule.fresh_keys(context).unsqueeze(-2)
        batch = torch.broadcast_shapes(fixed_point.shape[:-2], fresh.shape[:-2])
        stored = self.has_contents
        mu = torch.where(stored, self.initial_mu, fixed_point).expand(*batch, -1, -1)
        return MemoryState(mu, torch.where(stored, self.initial_keys, fresh).expand(*batch, -1, -1))

    def initial_mode(self, batch_shape: Sequence[int]) -> MemoryMode:
        """All slots active, the first where attention grows the set, or those stored.

        Boolean; numbers where attention is `graded`.
        """
        batch_shape = sizes("batch_shape", batch_shape)
        fresh = torch.ones_like(self.initial_active)
        if not self.attention.starts_full:
            fresh[1:] = False
        active = torch.where(self.has_contents, self.initial_active, fresh)
        active = active.expand(*batch_shape, -1).clone()
        if self.attention.graded:
            active = active.to(self.initial_mu.dtype)
        count = torch.zeros(batch_shape, dtype=torch.int64, device=active.device)
        return MemoryMode(active, count - 1, count, count.clone())

    def forward(
        self,
        hidden: Tensor,
        correction: Tensor,
        context: Tensor,
        memory: MemoryState,
        mode: MemoryMode,
    ) -> MemoryOutput:
        """Read h_o (..., N), weights w_r (..., S) and d memory/dt at features (..., N).

        `correction` (..., N) is W h_e'. Raises `ShapeError`, `DtypeError`.
        """
        self._check(hidden, context, (memory, mode), corrections=(correction,))
        weights = self._attend(hidden, context, memory, mode)
        d_mu = weights.unsqueeze(-1) * self.offset(hidden, correction, memory)
        d_keys = self.key_rule.derivative(weights, context, memory)
        return MemoryOutput(row_times(weights, memory.mu), weights, MemoryState(d_mu, d_keys))

    def attend(
        self, hidden: Tensor, context: Tensor, memory: MemoryState, mode: MemoryMode
    ) -> tuple[Tensor, Tensor]:
        """Weights w_r (..., S) and read h_o (..., N). Raises as `forward`."""
        self._check(hidden, context, (memory, mode))
        weights = self._attend(hidden, context, memory, mode)
        found = f"weights of {type(self.attention).__name__}"
        check_together([(found, weights, (self.n_slots,), self.initial_mu.dtype)])
        return weights, row_times(weights, memory.mu)

    def offset(self, hidden: Tensor, correction: Tensor | None, memory: MemoryState) -> Tensor:
        """c_w sigma + W h_e' - mu_i (..., S, N): how far each slot is from what is written."""
        target = self.write_gain.unsqueeze(-1) * hidden
        return (target if correction is None else target + correction).unsqueeze(-2) - memory.mu

    def jump(
        self, hidden: Tensor, context: Tensor, memory: MemoryState, mode: MemoryMode
    ) -> tuple[MemoryState, MemoryMode]:
        """Reallocate where attention asks for it, then note which slot is attended.

        The reset slot gets c_w sigma or sigma (`reset`) and a fresh key; no other slot changes.
        Raises `ShapeError`, `DtypeError`.
        """
        self._check(hidden, context, (memory, mode))
        memory, mode = self.reallocate(hidden, context, memory, mode)
        return memory, self.note(self._attend(hidden, context, memory, mode), mode)

    def note(self, weights: Tensor, mode: MemoryMode) -> MemoryMode:
        """The mode with the slot that has the largest weight (..., S), and whether it is new."""
        attended = weights.argmax(dim=-1)
        switched = (attended != mode.attended) & (mode.attended >= 0)
        return mode._replace(attended=attended, switches=mode.switches + switched)

    def reallocate(
        self,
        hidden: Tensor,
        context: Tensor,
        memory: MemoryState,
        mode: MemoryMode,
        due: Tensor | None = None,
    ) -> tuple[MemoryState, MemoryMode]:
        """Reset the slot that attention names where it asks for it, or where `due` (...,) says.

        Relaxed attention resets each slot to a degree; one of more than half counts. A fresh state
        key can equal another slot's, where the state stands still: the lowest index wins that tie.
        """
        if not self.attention.reallocates:
            return memory, mode
        shift = self.attention.decide_shift(self.relevance(hidden, memory), mode)
        if shift is None:  # never
            return memory, mode
        fires = shift.fires if due is None else due
        degree = shift.target * fires.unsqueeze(-1)
        each = degree.unsqueeze(-1)
        gain = self.write_gain.unsqueeze(-1) if self.reset == "scaled" else 1.0
        fresh = self.key_rule.fresh_keys(context)
        memory = MemoryState(
            blend(each, (gain * hidden).unsqueeze(-2), memory.mu),
            blend(each, fresh.unsqueeze(-2), memory.keys),
        )
        return memory, mode._replace(
            active=blend(degree, torch.ones_like(mode.active), mode.active),
            reallocations=mode.reallocations + (degree > 0.5).any(dim=-1),
        )

    def proximity(
        self, hidden: Tensor, context: Tensor, memory: MemoryState, mode: MemoryMode
    ) -> Proximity:
        """What decides the next switch and the next reset, differentiable."""
        comparison = self.key_rule.query_keys(hidden, context, memory, self.write_gain)
        distances = self.attention.distances(comparison, mode.active)
        return Proximity(distances, self.attention.margin(self.relevance(hidden, memory), mode))

    def relevance(self, hidden: Tensor, memory: MemoryState) -> Tensor:
        """|sigma - mu_i / c_w|_inf (..., S)."""
        return infinity_distances(hidden, memory.mu / per_matrix(self.write_gain))

    def magnitude(self, memory: MemoryState, mode: MemoryMode) -> Tensor:
        """|mu|_F (...,) over the active slots; a slot not yet in use holds nothing."""
        return frobenius(memory.mu * mode.active.unsqueeze(-1))

    def store_(self, state: MemoryState, active: Tensor | None = None) -> None:
        """Keep one unbatched state, mu (S, N), as the contents to start from.

        `active` (S,) bool says which slots are in use, all if not given; of levels those above one
        half. Raises `ShapeError` for a batch, `ConfigError` where no slot is active, `KindError`.
        """
        instance("state", state, MemoryState)
        active = None if active is None else instance("active", active, Tensor) > 0.5
        if state.mu.shape != self.initial_mu.shape or state.keys.shape != self.initial_keys.shape:
            mine, given = (
                f"mu {tuple(mu.shape)} and keys {tuple(keys.shape)}"
                for mu, keys in ((self.initial_mu, self.initial_keys), state)
            )
            raise ShapeError(f"store_ takes one memory, {mine}; got {given}: choose one sample")
        if active is not None and not bool(active.any()):
            raise ConfigError("store_: no slot is active; at least one must be in use")
        self.initial_mu.copy_(state.mu.detach())
        self.initial_keys.copy_(state.keys.detach())
        self.initial_active.copy_(
            torch.ones_like(self.initial_active) if active is None else active
        )
        self.has_contents.fill_(True)

    def _attend(
        self, hidden: Tensor, context: Tensor, memory: MemoryState, mode: MemoryMode
    ) -> Tensor:
        if mode.held is not None:
            return mode.held
        comparison = self.key_rule.query_keys(hidden, context, memory, self.write_gain)
        return cast(Tensor, self.attention(comparison, mode.active))

    def _check(
        self,
        hidden: Tensor,
        context: Tensor,
        *held: tuple[MemoryState, MemoryMode],
        corrections: tuple[Tensor, ...] = (),
    ) -> None:
        S, N, dtype = self.n_slots, self.n_hidden, self.initial_mu.dtype
        wide = (self.context_width or instance("context", context, Tensor).shape[-1],)
        rows: list[Row] = [("features", hidden, (N,), dtype), ("context", context, wide, dtype)]
        for memory, mode in held:
            instance("memory", memory, MemoryState), instance("mode", mode, MemoryMode)
            kind = dtype if self.attention.graded else torch.bool
            rows += [
                ("mu", memory.mu, (S, N), dtype),
                ("keys", memory.keys, (S, self.initial_keys.shape[-1]), dtype),
                ("active", mode.active, (S,), kind),
            ]
            rows += [] if mode.held is None else [("held weights", mode.held, (S,), dtype)]
        rows += [("correction", each, (N,), dtype) for each in corrections]
        check_together(rows)
