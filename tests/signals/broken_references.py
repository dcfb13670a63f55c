"""References that break their contract, a line each."""

from __future__ import annotations

import torch

from mann_torch.signals import PiecewiseConstant, Reference
from mann_torch.types import ReferenceSample


class Ramp(Reference):
    """Right in all: what the others break."""

    order = 1

    def __init__(self) -> None:
        super().__init__()
        self.slope: torch.Tensor
        self.hold("slope", [1.0, -2.0])
        self.width = 2

    def at(self, t: torch.Tensor) -> ReferenceSample:
        return ReferenceSample(self.slope * t, self.slope.expand_as(self.slope * t))


class NotRegistered(Ramp):
    def __init__(self) -> None:
        super().__init__()
        self.start = torch.ones(2, dtype=torch.float64)


class InAList(Ramp):
    def __init__(self) -> None:
        super().__init__()
        self.starts = [torch.ones(2, dtype=torch.float64)]


class AParameter(Ramp):
    def __init__(self) -> None:
        super().__init__()
        self.start = torch.nn.Parameter(torch.ones(2, dtype=torch.float64))


class WrongOrder(Ramp):
    order = 2


class NoWidth(Ramp):
    def __init__(self) -> None:
        super().__init__()
        del self.width


class WrongWidth(Ramp):
    def __init__(self) -> None:
        super().__init__()
        self.width = 3


class WrongRate(Ramp):
    def at(self, t: torch.Tensor) -> ReferenceSample:
        return ReferenceSample(self.slope * t, 1.001 * self.slope.expand_as(self.slope * t))


class Detached(Ramp):
    def at(self, t: torch.Tensor) -> ReferenceSample:
        return super().at(t.detach())


class SinglePrecision(Ramp):
    def at(self, t: torch.Tensor) -> ReferenceSample:
        return ReferenceSample(*(part.float() for part in super().at(t)[:2] if part is not None))


class Decides(Ramp):
    def at(self, t: torch.Tensor) -> ReferenceSample:
        return super().at(t if bool(t > 1.0) else 2.0 * t)


class Looks(Ramp):
    """A decision in Python that plain calls do not notice."""

    def at(self, t: torch.Tensor) -> ReferenceSample:
        return super().at(t + 0.0 * float(t.detach().sum()))


class RateNotSpread(Ramp):
    def at(self, t: torch.Tensor) -> ReferenceSample:
        return ReferenceSample(self.slope * t, self.slope)


class ATuple(Ramp):
    def at(self, t: torch.Tensor) -> ReferenceSample:
        return (self.slope * t, self.slope.expand_as(self.slope * t))  # type: ignore[return-value]


class FromTheLeft(Ramp):
    order = 0

    def at(self, t: torch.Tensor) -> ReferenceSample:
        return ReferenceSample(torch.where(t > 1.0, self.slope, 0.0 * self.slope))


class AcrossTheBatch(Ramp):
    order = 0

    def at(self, t: torch.Tensor) -> ReferenceSample:
        return ReferenceSample(self.slope - 0.5 * self.slope.mean() + 0.0 * t)


class NoGradient(Ramp):
    def at(self, t: torch.Tensor) -> ReferenceSample:
        slope = self.slope.detach()
        return ReferenceSample(slope * t, slope.expand_as(slope * t))


class LeakyWhere(Ramp):
    order = 0

    def at(self, t: torch.Tensor) -> ReferenceSample:
        x = self.slope * t
        return ReferenceSample(torch.where(x > 0, torch.sqrt(x), 0.0 * x))


class NotFinite(Ramp):
    order = 0

    def at(self, t: torch.Tensor) -> ReferenceSample:
        return ReferenceSample(self.slope / t)


class OwnExpand(Ramp):
    def expand(self, batch_shape):  # type: ignore[no-untyped-def]
        return self


class OwnAligned(Ramp):
    def aligned(self, t: torch.Tensor) -> ReferenceSample:
        return self.at(0.5 * t.unsqueeze(-1))


class OneTime(Ramp):
    def at(self, t: torch.Tensor) -> ReferenceSample:
        return super().at(t.reshape(()))


class BadPart(Ramp):
    """A tensor hides in a schedule of its own."""

    def __init__(self) -> None:
        super().__init__()
        self.schedule = PiecewiseConstant([1.0], [[1.0, 1.0], [2.0, 2.0]])
        self.schedule.more = torch.ones(2, dtype=torch.float64)


#: Each with what its error must say: the contract's line, and what it is about.
BROKEN: dict[type[Reference], str] = {
    NotRegistered: r"line 1: start is a tensor .*self\.hold",
    InAList: r"line 1: starts is a tensor .*self\.hold",
    AParameter: r"line 1: start is a tensor .*self\.hold",
    BadPart: r"line 1: schedule\.more is a tensor .*self\.hold",
    OwnExpand: "line 1: expand gave batch shape .*do not override",
    WrongOrder: "line 2: order = 2, forward .* gave 1 derivatives",
    NoWidth: "line 2: width = None",
    WrongWidth: r"line 3: value has shape \(2,\), not \(3,\)",
    WrongRate: "line 3: rate is not the derivative of value .*at t =",
    Detached: "line 3: rate is not the derivative of value .*must not be detached",
    SinglePrecision: r"line 3: value is torch\.float32; compute in float64",
    Decides: "line 3: .* raised .*decisions are by `where`",
    Looks: "line 3: .* raised .*decisions are by `where`",
    RateNotSpread: r"line 3: rate has shape \(2,\), not \(12, 2\)",
    ATuple: "line 3: .*gave a tuple; return a ReferenceSample",
    AcrossTheBatch: "line 3: value of a sample depends on the batch",
    OwnAligned: "line 3: value of `aligned`",
    NoGradient: "line 3: no gradient reaches any of its rows; .*no detach",
    LeakyWhere: "line 3: the gradient of slope is not finite; `where` leaks",
    NotFinite: "line 3: value is not finite at t = 0.0",
    OneTime: r"line 3: forward at t of shape \(12,\) raised",
    FromTheLeft: "line 4: it jumps just after t = 1; compare with t >=",
}
