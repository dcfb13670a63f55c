"""Motions through waypoints: boundary conditions, and that none has less jerk."""

import pytest
import torch

import mann_torch as mt
from mann_torch.signals import MinimumJerk, Polynomial, Quintic
from tests.conftest import randn

TIMES, POINTS = [1.0, 2.5, 3.0], [[0.0, 1.0], [2.0, -1.0], [0.5, 0.25]]


def at(*times: float) -> torch.Tensor:
    return torch.tensor(times, dtype=torch.float64)


def test_it_passes_its_waypoints_at_rest_and_holds_still_outside() -> None:
    sample = MinimumJerk(TIMES, POINTS)(at(0.0, *TIMES, 7.0))
    rows = torch.tensor(POINTS, dtype=torch.float64)[[0, 0, 1, 2, 2]]
    assert torch.equal(sample.value, rows)
    for part in sample.upto(2)[1:]:
        torch.testing.assert_close(part, 0 * part, rtol=0, atol=1e-12)
    for part in MinimumJerk(TIMES, POINTS)(at(0.0, 3.0, 7.0)).upto(4)[1:]:
        assert not part.any()
    approached = MinimumJerk(TIMES, POINTS)(at(3.0 - 1e-7))
    for part, wanted in zip(approached.upto(2), (rows[4], 0 * rows[4], 0 * rows[4]), strict=True):
        torch.testing.assert_close(part[0], wanted, rtol=0, atol=2e-3)


def test_between_two_it_is_the_quintic_of_flash_and_hogan() -> None:
    s = torch.linspace(0.0, 0.99, 50, dtype=torch.float64)
    sample = MinimumJerk([1.0, 3.0], [[1.0], [4.0]])(1.0 + 2.0 * s)
    wanted = [
        1.0 + 3.0 * (10 * s**3 - 15 * s**4 + 6 * s**5),
        3.0 / 2 * (30 * s**2 - 60 * s**3 + 30 * s**4),
        3.0 / 4 * (60 * s - 180 * s**2 + 120 * s**3),
        3.0 / 8 * (60 - 360 * s + 360 * s**2),
        3.0 / 16 * (-360 + 720 * s),
    ]
    for part, row in zip(sample.upto(4), wanted, strict=True):
        torch.testing.assert_close(part[:, 0], row, rtol=0, atol=1e-12)


def test_no_motion_from_rest_to_rest_has_less_jerk() -> None:
    """The integral of jerk^2 is 720 D^2 / T^5; any quintic with other ends between has more."""
    times, ends = torch.tensor([0.0, 0.7, 2.0]).double(), torch.tensor([[0.0], [0.6], [1.0]])
    t = (torch.arange(20000, dtype=torch.float64) + 0.5) * 1e-4

    def jerk(reference: Quintic) -> float:
        found = reference(t).jerk
        assert found is not None
        return float(found.square().mean() * 2.0)

    least = jerk(MinimumJerk([0.0, 2.0], [[0.0], [1.0]]))
    assert least == pytest.approx(720.0 / 2.0**5, rel=1e-6)
    best = MinimumJerk([0.0, 2.0], [[0.0], [1.0]])(times)
    assert best.rate is not None and best.acceleration is not None
    same = Quintic(times, best.value, best.rate, best.acceleration)
    assert jerk(same) == pytest.approx(least, rel=1e-6)
    for seed in range(5):
        bump = torch.zeros(3, 1).double()
        bump[1] = 0.1 * randn(1, seed=seed)
        for other in (
            Quintic(times, best.value + bump, best.rate, best.acceleration),
            Quintic(times, best.value, best.rate + bump, best.acceleration),
            Quintic(times, best.value, best.rate, best.acceleration + bump),
            MinimumJerk(times, ends.double() + bump),
        ):
            assert jerk(other) > least * (1 + 1e-6)


def test_a_quintic_gives_back_polynomials_up_to_degree_5() -> None:
    line = Polynomial(randn(6, 2))
    times = at(-1.0, 0.2, 1.5)
    ends = line(times)
    assert ends.rate is not None and ends.acceleration is not None
    t = torch.linspace(-1.0, 1.49, 60, dtype=torch.float64)
    found = Quintic(times, ends.value, ends.rate, ends.acceleration)(t)
    for k, (mine, theirs) in enumerate(zip(found.upto(4), line(t).upto(4), strict=True)):
        torch.testing.assert_close(mine, theirs, rtol=0, atol=1e-12 * 10**k)


def test_gradients_in_times_and_waypoints_are_those_of_finite_differences() -> None:
    t = at(1.3, 2.0, 2.7)

    def value(times: torch.Tensor, points: torch.Tensor, v: torch.Tensor) -> torch.Tensor:
        return Quintic(times, points, v, 2.0 * v)(t).value

    given = (at(*TIMES), torch.tensor(POINTS).double(), randn(3, 2))
    assert torch.autograd.gradcheck(value, tuple(x.requires_grad_() for x in given))


def test_bad_arguments_are_named() -> None:
    with pytest.raises(mt.ShapeError, match=r"MinimumJerk of times .* at least 2 times"):
        MinimumJerk([1.0], [[0.0]])
    with pytest.raises(mt.ShapeError, match="a row for each"):
        MinimumJerk(TIMES, POINTS[:2])
    with pytest.raises(mt.ConfigError, match=r"MinimumJerk times .* must increase"):
        MinimumJerk([1.0, 1.0], POINTS[:2])
    with pytest.raises(mt.ConfigError, match=r"Quintic times .* finite"):
        Quintic([1.0, float("inf")], POINTS[:2])
    with pytest.raises(mt.ShapeError, match="Quintic velocities has shape"):
        Quintic(TIMES, POINTS, [[1.0, 2.0, 3.0]])
    with pytest.raises(mt.KindError, match="Quintic accelerations"):
        Quintic(TIMES, POINTS, 0.0, "fast")  # type: ignore[arg-type]
