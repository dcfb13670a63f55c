"""What stands between a controller's input and the plant's."""

from __future__ import annotations

import torch
from torch import Tensor

from ..checks import whole
from ..constraints import DesignModule, FiniteRow, PositiveRow
from ..errors import ConfigError, DomainError
from ..functional import Numbers, as_float64
from ..types import InputGains


class Actuator(DesignModule):
    """Limits, a lag, a limit on the rate: a = sat(u), or da/dt = clamp((sat(u) - a) / lag, +-rate).

    `lower` and `upper` (m,) bound what is applied; `limit` is short for both, -limit and limit.
    `lag` (m,) [s] is a first-order lag, and `rate_limit` (m,) [1/s] bounds how fast its output
    moves: without a lag there is none to bound. Each is a number or m of them, in the plant's
    units; None: no such thing. With a lag, what is applied starts at `sat(0)`.

    Constants, by name: `lower`, `upper`, `lag`, `rate_limit`. Raises `ConfigError` for nothing at
    all, for a rate limit without a lag and for `limit` beside `lower` or `upper`, `DomainError`
    for constants out of range or lower > upper, `ShapeError`, `KindError`, `DtypeError`.
    """

    lag: Tensor

    def __init__(
        self,
        n_inputs: int,
        limit: Numbers | None = None,
        lag: Numbers | None = None,
        rate_limit: Numbers | None = None,
        lower: Numbers | None = None,
        upper: Numbers | None = None,
    ) -> None:
        super().__init__()
        self.n_inputs = m = whole("n_inputs", n_inputs)
        if limit is not None and (lower is not None or upper is not None):
            raise ConfigError("actuator: give limit, or lower and upper")
        if all(part is None for part in (limit, lag, rate_limit, lower, upper)):
            raise ConfigError("actuator: give limit, lower, upper or lag; none at all is no part")
        if rate_limit is not None and lag is None:
            raise ConfigError("actuator rate_limit: give a lag [s] too, whose rate it bounds")
        if limit is not None:
            size = PositiveRow().check("actuator limit", as_float64(limit, "limit").detach())
            self.declare("upper", size, PositiveRow(), (m,))
            self.declare("lower", -self.constant("upper").detach(), FiniteRow(), (m,))
        for name, value, domain in (
            ("lower", lower, FiniteRow()),
            ("upper", upper, FiniteRow()),
            ("lag", lag, PositiveRow()),
            ("rate_limit", rate_limit, PositiveRow()),
        ):
            if value is not None:
                self.declare(name, value, domain, (m,))
        self.check()

    def check_together(self) -> None:
        """Raise `DomainError` if lower is above upper."""
        lower, upper = self._get("lower"), self._get("upper")
        if lower is None or upper is None:
            return
        self.batch_shape()  # raises where they do not broadcast
        if bool((lower > upper).any()):
            raise DomainError(f"actuator: lower {lower.tolist()} is above upper {upper.tolist()}")

    def _get(self, name: str) -> Tensor | None:
        return getattr(self, name) if name in self.domains() else None

    def initial_state(self, u: Tensor) -> Tensor | None:
        """What is applied at t = 0, (..., m) like u; None without a lag."""
        return None if self._get("lag") is None else self.saturated(torch.zeros_like(u))

    def saturated(self, u: Tensor) -> Tensor:
        """u (..., m) within the limits."""
        lower, upper = self._get("lower"), self._get("upper")
        if lower is not None:
            u = torch.maximum(u, lower)
        return u if upper is None else torch.minimum(u, upper)

    def forward(self, u: Tensor, state: Tensor | None) -> tuple[Tensor, Tensor | None]:
        """What is applied (..., m) for a commanded u (..., m), and d state/dt."""
        wanted = self.saturated(u)
        lag = self._get("lag")
        if lag is None or state is None:
            return wanted, None
        rate = (wanted - state) / lag
        bound = self._get("rate_limit")
        if bound is not None:
            rate = torch.minimum(torch.maximum(rate, -bound), bound)
        return state, rate

    def pull(self, u: Tensor, state: Tensor) -> Tensor:
        """1/lag (..., m) [1/s], where the rate answers to u (..., m) at all: 0 at its limit."""
        lag, bound = self.lag, self._get("rate_limit")
        pull = (1.0 / lag).expand(u.shape)
        if bound is None:
            return pull
        free = ((self.saturated(u) - state) / lag).abs() < bound
        return torch.where(free, pull, 0.0)

    def passed(self, u: Tensor, gains: InputGains | None) -> InputGains | None:
        """How u within the limits answers, where u does by `gains`: nowhere beyond them."""
        if gains is None:
            return None
        free = (self.saturated(u) == u).to(u.dtype)
        return InputGains(gains.measurement * free.unsqueeze(-1), gains.drift * free)
