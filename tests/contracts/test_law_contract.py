"""Every adaptive law keeps its contract, and `check_law` refuses what does not."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import pytest
import torch
from torch import Tensor

import mann_torch as mt
from mann_torch.constraints import Positive
from mann_torch.control import (
    LAW_PARTS,
    LAWS,
    AdaptiveLaw,
    BoxProjection,
    Composite,
    ConcurrentLearning,
    ConstantGain,
    DeadZone,
    Drem,
    Drive,
    EModification,
    FreezeWhileSaturated,
    Law,
    LeastSquares,
    Normalisation,
    Projection,
    SigmaModification,
    SwitchingSigma,
)
from mann_torch.errors import InterfaceError
from mann_torch.functional import outer, per_matrix, times_column
from mann_torch.testing import check_law

FOUR = [0.3, 0.0, 1.0, 2.0]
#: A new mechanism is a line here.
LAWS_TO_CHECK: dict[str, Callable[[], Law]] = {
    "gradient": lambda: AdaptiveLaw(ConstantGain(2.0)),
    "gradient, standing": lambda: AdaptiveLaw(ConstantGain(0.0)),
    "gradient, a row": lambda: AdaptiveLaw(ConstantGain([1.0, 2.0, 0.0, 0.5])),
    "gradient, a matrix": lambda: AdaptiveLaw(
        ConstantGain((torch.eye(4) + 0.3).double()), SigmaModification(0.1)
    ),
    "e-modification": lambda: AdaptiveLaw(EModification(0.3)),
    "sigma": lambda: AdaptiveLaw(SigmaModification(0.3)),
    "sigma, a row": lambda: AdaptiveLaw(SigmaModification([0.3, 0.0, 1.0, 2.0])),
    "box": lambda: AdaptiveLaw(ConstantGain([5.0, 1.0, 0.0, 2.0]), BoxProjection(0.5, 0.1)),
    "projection": lambda: AdaptiveLaw(ConstantGain(5.0), Projection(2.0, 0.1)),
    "switching sigma": lambda: AdaptiveLaw(SwitchingSigma(0.3, 1.5)),
    "switching sigma, a row": lambda: AdaptiveLaw(SwitchingSigma(FOUR, 1.5)),
    "least squares": lambda: AdaptiveLaw(LeastSquares(2.0)),
    "least squares, bounded": lambda: AdaptiveLaw(
        LeastSquares(FOUR, 0.3, gain_normalisation=0.1, gain_bound=10.0)
    ),
    "least squares, reset": lambda: AdaptiveLaw(LeastSquares(2.0, reset_at=1.9)),
    "least squares, a matrix": lambda: AdaptiveLaw(
        LeastSquares((torch.eye(4) + 0.3).double(), 0.5), SigmaModification(0.1)
    ),
    "composite": lambda: AdaptiveLaw(ConstantGain(2.0), Composite(0.3)),
    "composite, a row": lambda: AdaptiveLaw(ConstantGain(2.0), Composite([0.3, 0.5])),
    "composite least squares": lambda: AdaptiveLaw(LeastSquares(2.0), Composite(0.3)),
    "concurrent learning": lambda: AdaptiveLaw(ConcurrentLearning(0.3, 2, 0.02)),
    "concurrent learning, at once": lambda: AdaptiveLaw(
        ConcurrentLearning(0.3, 3, 0.04, first=0.0), SigmaModification(0.1)
    ),
    "concurrent learning, a cycle": lambda: AdaptiveLaw(
        ConcurrentLearning(0.3, 2, 0.02, keeps="cycle", rows=2)
    ),
    "concurrent learning, frozen": lambda: AdaptiveLaw(
        ConcurrentLearning(0.3, points=[FOUR, [0.0, 1.0, 0.0, 1.0]], labels=[[1.0], [2.0]])
    ),
    "dead zone": lambda: AdaptiveLaw(DeadZone(0.4)),
    "normalisation": lambda: AdaptiveLaw(Normalisation(0.4)),
    "normalisation, a row": lambda: AdaptiveLaw(Normalisation(FOUR)),
    "freeze while saturated": lambda: AdaptiveLaw(FreezeWhileSaturated()),
    "drem": lambda: Drem(2.0, 0.95),
    "drem, a row": lambda: Drem(FOUR, 0.95),
    "all together": lambda: AdaptiveLaw(
        LeastSquares(2.0, 0.3, gain_bound=9.0),
        *(SigmaModification(0.1), EModification(0.1), SwitchingSigma(0.2, 1.5)),
        *(Composite(0.3), ConcurrentLearning(0.2, 2, 0.04), DeadZone(0.1), Normalisation(0.1)),
        Projection(3.0, 0.1),
    ),
}


@pytest.mark.parametrize("name", LAWS_TO_CHECK)
def test_a_law_of_the_library_keeps_its_contract(name: str) -> None:
    check_law(LAWS_TO_CHECK[name]())


def test_the_list_has_every_law_and_mechanism_there_is() -> None:
    laws = [make() for make in LAWS_TO_CHECK.values()]
    assert {type(law) for law in laws} == set(LAWS.values())
    parts = {type(part) for law in laws if isinstance(law, AdaptiveLaw) for part in law.parts}
    assert parts == set(LAW_PARTS.values())


class Gain(NamedTuple):
    P: Tensor  # (..., N, N)


class Good(Law):
    """Least squares: d theta = g P phi s', dP = -g P phi phi' P. What the others break."""

    rows = 1

    def __init__(self) -> None:
        super().__init__()
        self.rate: Tensor
        self.declare("rate", 0.5, Positive())

    def initial_state(self, n_features, n_outputs, batch_shape):
        eye = torch.eye(n_features, dtype=torch.float64)
        return Gain(eye.expand(*batch_shape, n_features, n_features))

    def forward(self, drive, estimate, state, mode=None):
        phi, error = drive.regressor[..., 0], drive.error[..., 0, :]
        along = times_column(state.P, phi)
        rate = per_matrix(self.rate)
        return rate * outer(along, error), Gain(-rate * outer(along, along))


def changed(base: type = Good, **members: Any) -> Law:
    return type("Broken", (base,), members)()


def other(compute: Callable[..., Any]) -> Law:
    """With another answer, of (self, right one, phi, s, theta, state)."""

    def forward(self, drive, estimate, state, mode=None):
        right = Good.forward(self, drive, estimate, state)
        phi, error = drive.regressor[..., 0], drive.error[..., 0, :]
        return compute(self, right, phi, error, estimate, state)

    return changed(forward=forward)


def starting(make: Callable[..., Any]) -> Law:
    return changed(initial_state=lambda self, n, m, batch: make(n, m, tuple(batch)))


def sigma(self, drive, estimate, state, mode=None):
    rate, d_state = Good.forward(self, drive, estimate, state)
    return rate - 0.1 * estimate, d_state


def grown(self, drive, estimate, state, mode=None):
    rate, d_state = Good.forward(self, drive, estimate, state)
    return rate + 0.1 * estimate, d_state


BROKEN: dict[str, tuple[Callable[[], Law], str]] = {
    "a state in a list": (
        lambda: starting(lambda n, m, batch: [torch.eye(n).double()]),
        "line 2: initial_state gives no NamedTuple",
    ),
    "a state without its batch": (
        lambda: starting(lambda n, m, batch: Gain(torch.eye(n).double())),
        "line 2: initial_state for a batch",
    ),
    "a state by chance": (
        lambda: starting(lambda n, m, batch: Gain(torch.randn(*batch, n, n).double())),
        "line 2: initial_state gives another state each time",
    ),
    "one answer": (
        lambda: other(lambda self, right, *_: right[0]),
        "line 3: forward gives a Tensor; return d theta/dt and d state/dt",
    ),
    "a rate of another shape": (
        lambda: other(lambda self, right, *_: (right[0].mT, right[1])),
        r"line 1: d theta/dt has shape \(8, 3, 4\), not \(8, 4, 3\)",
    ),
    "a rate of float32": (
        lambda: other(lambda self, right, *_: (right[0].float(), right[1])),
        "line 1: d theta/dt is torch.float32",
    ),
    "no rate of the state": (
        lambda: other(lambda self, right, *_: (right[0], None)),
        "line 2: d state/dt is not like the state: it is a NoneType, not a Gain",
    ),
    "columns that mix": (
        lambda: other(
            lambda self, right, phi, s, *_: (right[0] + outer(phi, s.flip(-1)), right[1])
        ),
        "line 1: column 0 of the estimates moves otherwise among others",
    ),
    "a gain that errors move": (
        lambda: other(
            lambda self, right, phi, s, theta, state: (
                right[0],
                Gain(right[1].P * (1.0 + s.square().sum(-1)[..., None, None])),
            )
        ),
        "line 1: column 0 of the estimates moves otherwise among others",
    ),
    "a motion without an error": (
        lambda: changed(forward=sigma),
        "line 4: estimates move without an error; .*`decays = True`",
    ),
    "a decay that grows": (
        lambda: changed(forward=grown, decays=True),
        "line 4: estimates grow without an error, though it says that they decay",
    ),
    "random numbers": (
        lambda: other(
            lambda self, right, phi, s, theta, state: (
                right[0] * (1.0 + 1e-13 * torch.rand_like(right[0])),
                right[1],
            )
        ),
        "line 3: forward gives other numbers for the same arguments",
    ),
    "samples that mix": (
        lambda: other(
            lambda self, right, phi, s, *_: (
                right[0] * (phi.mean() if phi.dim() > 1 else 1.0),
                right[1],
            )
        ),
        "line 3: sample 0 of a batch has another forward",
    ),
    "a regressor detached": (
        lambda: other(
            lambda self, right, phi, s, theta, state: Good.forward(
                self, Drive.of_features(phi.detach(), s, phi.norm(dim=-1)), theta, state
            )
        ),
        "line 3: the gradient of forward by the regressor is not what finite",
    ),
}


def test_right_laws_of_ones_own_pass() -> None:
    check_law(Good())
    check_law(changed(forward=sigma, decays=True))
    with pytest.raises(mt.KindError, match="law = 3"):
        check_law(3)  # type: ignore[arg-type]


@pytest.mark.parametrize("name", BROKEN)
def test_a_broken_law_is_refused_by_what_is_wrong(name: str) -> None:
    make, told = BROKEN[name]
    with pytest.raises(InterfaceError, match=rf"^\w+, contract .*(?:{told})"):
        check_law(make())
