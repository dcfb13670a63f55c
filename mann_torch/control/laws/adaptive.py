"""A law composed of mechanisms."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

from torch import Tensor, nn

from ...checks import instance
from ...errors import ConfigError
from ...functional import per_matrix
from ...trees import leaves, portable
from .constant_gain import ConstantGain
from .drive import Drive
from .law import Law
from .part import Gain, GainInForce, Gate, Guard, LawPart, Leak, Term


@portable
class Beside(NamedTuple):
    """What one term keeps, and what the terms after it keep."""

    first: Any
    rest: Any


@portable
class LawState(NamedTuple):
    """What gain and terms keep; None where they keep nothing."""

    gain: Any
    terms: Any


class AdaptiveLaw(Law):
    """d theta/dt = guard(Gamma (gates(Phi s) - leaks + terms)).

    Of mechanisms in any order: what each does follows from its kind. At most one is a `Gain`, a
    `ConstantGain` of 1 if none is, and at most one a `Guard`; leaks, terms and gates follow each
    other as they are given. Raises `ConfigError`, `KindError`.
    """

    def __init__(self, *parts: LawPart) -> None:
        super().__init__()
        for part in parts:
            instance("parts", part, LawPart)
        gains = _of_kind(parts, Gain)
        guards = _of_kind(parts, Guard)
        for what, found in (("gain", gains), ("guard", guards)):
            if len(found) > 1:
                told = " and ".join(type(part).__name__ for part in found)
                raise ConfigError(f"parts hold {told}: a law has one {what}")
        told_rows = sorted({part.rows for part in parts if part.rows is not None})
        if len(told_rows) > 1:
            raise ConfigError(
                f"parts take regressors (N, r) of r = {told_rows}: all must take the same"
            )
        self.gain: Gain = gains[0] if gains else ConstantGain()
        self.guard: Guard | None = guards[0] if guards else None
        self.gates = nn.ModuleList(_of_kind(parts, Gate))
        self.leaks = nn.ModuleList(_of_kind(parts, Leak))
        self.terms = nn.ModuleList(_of_kind(parts, Term))
        self._nothing = LawState(None, _chain([None] * len(self.terms)))  # where it keeps nothing

    @property
    def parts(self) -> list[LawPart]:
        """All mechanisms, in the order in which they act."""
        guard = [] if self.guard is None else [self.guard]
        found: list[Any] = [*self.gates, self.gain, *self.leaks, *self.terms, *guard]
        return found

    @property
    def decays(self) -> bool:
        """Whether a leak pulls without an error."""
        return any(leak.decays for leak in self.leaks if isinstance(leak, Leak))

    @property
    def drives(self) -> bool:
        """Whether one of its mechanisms does."""
        return any(part.drives for part in self.parts)

    @property
    def needs(self) -> frozenset[str]:
        """What its mechanisms need together."""
        return frozenset().union(*(part.needs for part in self.parts))

    @property
    def rows(self) -> int | None:
        """What its mechanisms agree on."""
        return next((part.rows for part in self.parts if part.rows is not None), None)

    @property
    def periods(self) -> tuple[float, ...]:
        """Of all its mechanisms."""
        return tuple(period for part in self.parts for period in part.periods)

    @property
    def resets(self) -> bool:
        """Whether one of them does."""
        return any(part.resets for part in self.parts)

    def initial_state(
        self, n_features: int, n_outputs: int, batch_shape: Sequence[int]
    ) -> LawState | None:
        """Of gain and terms; None where they keep nothing. Raises `ShapeError`."""
        for part in self.parts:
            part.check_width(n_features)
        sizes = (n_features, n_outputs, batch_shape)
        terms = [term.initial_state(*sizes) for term in self._terms()]
        state = LawState(self.gain.initial_state(*sizes), _chain(terms))
        return state if leaves(state) else None

    def initial_mode(
        self, n_features: int, n_outputs: int, batch_shape: Sequence[int]
    ) -> LawState | None:
        """Of gain and terms; None where they decide nothing."""
        sizes = (n_features, n_outputs, batch_shape)
        terms = [term.initial_mode(*sizes) for term in self._terms()]
        mode = LawState(self.gain.initial_mode(*sizes), _chain(terms))
        return mode if leaves(mode) else None

    def forward(
        self, drive: Drive, estimate: Tensor, state: Any, mode: Any = None
    ) -> tuple[Tensor, LawState | None]:
        """d theta/dt (..., N, m) and d state/dt."""
        nothing = self._nothing
        held, modes = nothing if state is None else state, nothing if mode is None else mode
        for gate in self.gates:
            drive = gate(drive)
        rate = self.gain.drive(drive, held.gain)
        for leak in self.leaks:
            center: Tensor | None = leak.center  # type: ignore[assignment]
            away = estimate if center is None else estimate - center
            rate = self.gain.leaked(rate, leak(drive, estimate), away, held.gain)
        rates = []
        each = zip(self.terms, _unchained(held.terms), _unchained(modes.terms), strict=True)
        for term, kept, decided in each:
            push, moved = term(drive, estimate, kept, decided)
            rate = rate + self.gain.applied(push, held.gain)
            rates.append(moved)
        if self.guard is not None:
            rate = self.guard(rate, estimate, GainInForce(self.gain, held.gain))
        if drive.share is not None:
            rate = per_matrix(drive.share) * rate
        if state is None:
            return rate, None
        return rate, LawState(self.gain.rates(drive, held.gain), _chain(rates))

    def jump(self, drive: Drive, estimate: Tensor, state: Any, mode: Any) -> tuple[Any, Any]:
        """Of each mechanism."""
        nothing = self._nothing
        held, modes = nothing if state is None else state, nothing if mode is None else mode
        for gate in self.gates:
            drive = gate(drive)
        own, decided = self.gain.jump(drive, estimate, held.gain, modes.gain)
        each = zip(self._terms(), _unchained(held.terms), _unchained(modes.terms), strict=True)
        after = [term.jump(drive, estimate, s, m) for term, s, m in each]
        state = None if state is None else LawState(own, _chain([s for s, _ in after]))
        mode = None if mode is None else LawState(decided, _chain([m for _, m in after]))
        return state, mode

    def _terms(self) -> list[Term]:
        return [term for term in self.terms if isinstance(term, Term)]


def _of_kind(parts: Sequence[LawPart], kind: type) -> list[Any]:
    return [part for part in parts if isinstance(part, kind)]


def _chain(trees: Sequence[Any]) -> Any:
    chain: Any = None
    for tree in reversed(trees):
        chain = Beside(tree, chain)
    return chain


def _unchained(chain: Any) -> list[Any]:
    found = []
    while chain is not None:
        first, chain = chain
        found.append(first)
    return found
