"""What composing laws promises: a mechanism at 0 is none, order is none, what moves is said."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest
import torch
from torch import Tensor

from mann_torch.control import (
    LAW_PARTS,
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
    LawPart,
    LeastSquares,
    Normalisation,
    Pair,
    Projection,
    SigmaModification,
    SwitchingSigma,
)
from mann_torch.errors import ConfigError, DomainError, ShapeError
from mann_torch.trees import map_tensors

N, ROWS, COLUMNS, STEP = 4, 2, 3, 0.01


def randn(*shape: int, seed: int) -> Tensor:
    generator = torch.Generator().manual_seed(seed)
    return torch.randn(*shape, generator=generator, dtype=torch.float64)


def drive_of(seed: int, excess: float = 0.0) -> Drive:
    error = randn(5, ROWS, COLUMNS, seed=seed)
    pair = Pair(randn(5, N, ROWS, seed=seed + 1000), randn(5, ROWS, COLUMNS, seed=seed + 2000))
    cut = torch.full((5, COLUMNS), excess, dtype=torch.float64)
    return Drive(randn(5, N, ROWS, seed=seed + 3000), error, error.norm(dim=(-2, -1)), cut, pair)


def marched(law: Law, steps: int = 20, **given: Any) -> Tensor:
    """Estimates after some steps of Euler's, other drives at each."""
    theta = randn(5, N, COLUMNS, seed=9)
    sizes = (N, COLUMNS, (5,))
    state, mode = law.initial_state(*sizes), law.initial_mode(*sizes)
    for k in range(steps):
        drive = drive_of(k, **given)
        state, mode = law.jump(drive, theta, state, mode)
        rate, d_state = law(drive, theta, state, mode)
        theta = theta + STEP * rate
        state = map_tensors(lambda x, dx: x + STEP * dx, state, d_state)
    return theta


AT_ZERO: dict[str, Callable[[], LawPart]] = {
    "box_projection, far": lambda: BoxProjection(1e3),
    "composite": lambda: Composite(0.0),
    "composite, a row": lambda: Composite([0.0, 0.0]),
    "concurrent_learning": lambda: ConcurrentLearning(0.0, 2, 0.02, rows=ROWS),
    "concurrent_learning, frozen": lambda: ConcurrentLearning(
        0.0, points=[[1.0] * N], labels=[[2.0]]
    ),
    "dead_zone": lambda: DeadZone(0.0),
    "e_modification": lambda: EModification(0.0),
    "freeze_while_saturated, free": FreezeWhileSaturated,
    "normalisation": lambda: Normalisation(0.0),
    "normalisation, a row": lambda: Normalisation([0.0] * N),
    "projection, far": lambda: Projection(1e3),
    "sigma": lambda: SigmaModification(0.0, prior=1.0),
    "switching_sigma": lambda: SwitchingSigma(0.0, 0.1),
}
GAINS: dict[str, Callable[[], LawPart]] = {
    "constant": lambda: ConstantGain(2.0),
    "matrix": lambda: ConstantGain((torch.eye(N) + 0.3).double()),
    "least_squares": lambda: LeastSquares(2.0, 0.3),
}


@pytest.mark.parametrize("gain", GAINS)
@pytest.mark.parametrize("name", AT_ZERO)
def test_a_mechanism_at_zero_leaves_the_law_as_it_is_bit_for_bit(name: str, gain: str) -> None:
    plain = AdaptiveLaw(GAINS[gain]())
    assert torch.equal(marched(AdaptiveLaw(AT_ZERO[name](), GAINS[gain]())), marched(plain))
    assert not torch.equal(marched(plain), marched(plain, steps=0))


def test_every_mechanism_is_tried_at_zero() -> None:
    tried = {type(make()) for make in (*AT_ZERO.values(), *GAINS.values())}
    assert tried == set(LAW_PARTS.values())


IN_FORCE: dict[str, Callable[[], LawPart]] = {
    "box_projection": lambda: BoxProjection(0.7),
    "composite": lambda: Composite(0.3),
    "concurrent_learning": lambda: ConcurrentLearning(0.3, 2, 0.02, rows=ROWS),
    "dead_zone": lambda: DeadZone(0.2),
    "e_modification": lambda: EModification(0.2),
    "normalisation": lambda: Normalisation(0.2),
    "projection": lambda: Projection(1.0),
    "sigma": lambda: SigmaModification(0.2),
    "switching_sigma": lambda: SwitchingSigma(0.2, 0.6),
}


@pytest.mark.parametrize("name", IN_FORCE)
def test_the_same_mechanism_in_force_does_not(name: str) -> None:
    plain = marched(AdaptiveLaw(ConstantGain(2.0)))
    assert not torch.equal(marched(AdaptiveLaw(IN_FORCE[name](), ConstantGain(2.0))), plain)


def test_the_order_in_which_kinds_are_given_is_none() -> None:
    parts = [Projection(3.0), Composite(0.3), SigmaModification(0.2), DeadZone(0.1)]
    gain = LeastSquares(2.0, 0.3)
    forth, back = marched(AdaptiveLaw(gain, *parts)), marched(AdaptiveLaw(*parts[::-1], gain))
    assert torch.equal(forth, back)


def test_nothing_moves_while_the_input_is_cut() -> None:
    law = AdaptiveLaw(FreezeWhileSaturated(), LeastSquares(2.0, 0.3))
    assert torch.equal(marched(law, excess=-1e-9), randn(5, N, COLUMNS, seed=9))
    state = law.initial_state(N, COLUMNS, (5,))
    drive = drive_of(0, excess=1.0)
    drive = drive._replace(
        excess=torch.where(torch.arange(5).unsqueeze(-1) == 2, 0.0, 1.0).double()
    )
    rate, d_state = law(drive, randn(5, N, COLUMNS, seed=9), state)
    for moved in (rate, d_state.gain.P):
        assert (moved != 0).flatten(1).any(-1).tolist() == [False, False, True, False, False]


def test_a_stack_keeps_the_pairs_of_its_instants_and_no_others() -> None:
    """Period 2 steps, the first after 4: pairs of steps 4, 6, 8; with a cycle the last three."""
    for keeps, kept in (("first", [4, 6, 8]), ("cycle", [10, 12, 8])):
        law = AdaptiveLaw(ConcurrentLearning(0.3, 3, 0.02, 0.04, keeps, ROWS))
        theta = torch.zeros(5, N, COLUMNS, dtype=torch.float64)
        state, mode = law.initial_state(N, COLUMNS, (5,)), law.initial_mode(N, COLUMNS, (5,))
        for k in range(14):
            state, mode = law.jump(drive_of(k), theta, state, mode)
            state = map_tensors(
                lambda x, dx: x + STEP * dx, state, law(drive_of(k), theta, state, mode)[1]
            )
        stack = mode.terms.first
        for place, k in enumerate(kept):
            assert torch.equal(stack.regressors[:, place], drive_of(k).pair.regressor)
            assert torch.equal(stack.labels[:, place], drive_of(k).pair.label)
        assert stack.taken.tolist() == [3 if keeps == "first" else 5] * 5


def test_gains_that_fall_are_put_back() -> None:
    law = LeastSquares([1.0, 2.0, 3.0, 2.0], reset_at=1.5)
    first = law.initial_state(N, 1, (5,))
    size = torch.tensor([0.7, 0.75, 0.76, 1.0, 2.0], dtype=torch.float64)  # tr P(0)/N is 2
    state = first._replace(P=first.P * size[:, None, None])
    kept = law.jump(drive_of(0), torch.zeros(5, N, 1), state, None)[0]
    assert torch.equal(kept.P[:2], first.P[:2]) and torch.equal(kept.P[2:], state.P[2:])


def test_what_does_not_go_together_is_named() -> None:
    with pytest.raises(ConfigError, match="ConstantGain and LeastSquares: a law has one gain"):
        AdaptiveLaw(ConstantGain(), LeastSquares())
    with pytest.raises(ConfigError, match=r"of r = \[2, 3\]: all must take the same"):
        AdaptiveLaw(Composite([1.0, 1.0]), ConcurrentLearning(rows=3))
    with pytest.raises(ConfigError, match=r"first = 0\.3: give a multiple of period = 0\.2"):
        ConcurrentLearning(period=0.2, first=0.3)
    with pytest.raises(ConfigError, match="points and labels"):
        ConcurrentLearning(points=[[1.0]])
    with pytest.raises(ShapeError, match=r"not \(K, N\) and \(K, m\)"):
        ConcurrentLearning(points=[[1.0], [2.0]], labels=[[1.0]])
    with pytest.raises(DomainError, match="gain_bound"):
        LeastSquares(gain_bound=0.0)
    with pytest.raises(ConfigError, match="DREM of 7 estimates"):
        Drem().initial_state(7, 1, ())


def test_rows_and_matrices_of_other_estimates_are_named() -> None:
    for part, told in (
        (SigmaModification([0.1, 0.2, 0.3]), "sigma has 3 numbers: 2 are estimated"),
        (ConstantGain(torch.eye(3).double()), "adaptation_rate has 3 numbers"),
        (LeastSquares([1.0, 2.0, 3.0]), "initial_gain has 3 numbers"),
    ):
        with pytest.raises(ShapeError, match=told):
            AdaptiveLaw(part).initial_state(2, 1, ())
