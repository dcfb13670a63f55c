"""Splines: what they pass, what they give back, and that none bends less."""

import numpy as np
import pytest
import torch
from scipy.interpolate import CubicSpline, make_interp_spline

import mann_torch as mt
from mann_torch.signals import Polynomial, Quintic, Spline
from tests.conftest import generator, randn

EVERY = [(degree, ends) for degree in (3, 5) for ends in ("natural", "clamped")]
every = pytest.mark.parametrize(("degree", "ends"), EVERY)


def samples(n: int = 9, seed: int = 0) -> tuple[torch.Tensor, torch.Tensor]:
    gaps = 0.1 + torch.rand(n, generator=generator(seed), dtype=torch.float64)
    return gaps.cumsum(0), randn(n, 2, seed=seed)


def between(times: torch.Tensor, n: int = 400) -> torch.Tensor:
    share = (torch.arange(n, dtype=torch.float64) + 0.5) / n
    return times[0] + share * (times[-1] - times[0])


@every
def test_it_passes_its_samples_and_joins_smoothly(degree: int, ends: str) -> None:
    times, values = samples()
    spline = Spline(times, values, degree, ends)
    assert torch.equal(spline(times).value, values)
    before, after = spline(times[1:-1] - 1e-9), spline(times[1:-1])
    for k, (left, right) in enumerate(
        zip(before.upto(degree - 1), after.upto(degree - 1), strict=True)
    ):
        scale = max(float(left.abs().max()), 1.0)
        torch.testing.assert_close(left, right, rtol=0, atol=1e-6 * scale * 10**k)


@every
def test_it_is_the_spline_of_scipy(degree: int, ends: str) -> None:
    times, values = samples()
    t = between(times)
    spline = Spline(times, values, degree, ends)
    if degree == 3:
        other = CubicSpline(times.numpy(), values.numpy(), bc_type=ends)
    else:
        free = [(k, [0.0, 0.0]) for k in ((3, 4) if ends == "natural" else (1, 2))]
        other = make_interp_spline(times.numpy(), values.numpy(), k=5, bc_type=(free, free))
    assert spline.order == (3 if degree == 3 else 4)
    for k, part in enumerate(spline(t).upto(spline.order)):
        wanted = torch.from_numpy(other(t.numpy(), k))
        torch.testing.assert_close(part, wanted, rtol=0, atol=1e-12 * float(wanted.abs().max()))


@pytest.mark.parametrize("degree", [3, 5])
def test_clamped_to_its_own_ends_a_polynomial_is_given_back(degree: int) -> None:
    curve = Polynomial(randn(degree + 1, 2))
    times = torch.tensor([-1.0, -0.4, 0.3, 0.5, 1.5], dtype=torch.float64)
    at_ends = curve(times[[0, -1]])
    options = {"end_velocities": at_ends.rate}
    if degree == 5:
        options["end_accelerations"] = at_ends.acceleration
    spline = Spline(times, curve(times).value, degree, "clamped", **options)
    t = between(times)
    for k, (mine, theirs) in enumerate(zip(spline(t).upto(3), curve(t).upto(3), strict=True)):
        torch.testing.assert_close(mine, theirs, rtol=0, atol=1e-13 * 10**k)


def test_natural_ends_give_back_what_has_no_bending_and_no_jerk() -> None:
    times, _ = samples(6)
    t = between(times)
    for degree, rows in ((3, randn(2, 2)), (5, randn(3, 2))):
        curve = Polynomial(rows)
        spline = Spline(times, curve(times).value, degree)
        torch.testing.assert_close(spline(t).value, curve(t).value, rtol=0, atol=1e-12)


@every
def test_no_other_motion_through_the_samples_bends_less(degree: int, ends: str) -> None:
    """Other slopes at one sample between, or at free ends, have a larger integral."""
    times, values = samples(5)
    spline = Spline(times, values, degree, ends)
    # Three points of Gauss a piece: exact for the square of a parabola.
    points, weights = map(torch.from_numpy, np.polynomial.legendre.leggauss(3))
    lengths = times.diff()
    t = (times[:-1, None] + 0.5 * lengths[:, None] * (points + 1.0)).flatten()
    size = (0.5 * lengths[:, None] * weights).flatten()

    def bending(reference: Quintic) -> float:
        part = reference(t)[2 if degree == 3 else 3]
        assert part is not None
        return float(size @ part.square().sum(dim=-1))

    least = bending(spline)
    for k in range(5) if ends == "natural" else range(1, 4):
        for seed in range(3):
            bump = torch.zeros(5, 2).double()
            bump[k] = 0.05 * randn(2, seed=seed)
            moved = spline.velocities + bump, spline.accelerations
            assert bending(Quintic(times, values, *moved)) > least
            if degree == 5:
                moved = spline.velocities, spline.accelerations + bump
                assert bending(Quintic(times, values, *moved)) > least


@every
def test_gradients_in_samples_and_times_are_those_of_finite_differences(
    degree: int, ends: str
) -> None:
    times, values = samples(5)
    t = between(times, 4)

    def value(times: torch.Tensor, values: torch.Tensor) -> torch.Tensor:
        return Spline(times, values, degree, ends)(t).value

    assert torch.autograd.gradcheck(value, (times.requires_grad_(), values.requires_grad_()))


@every
def test_a_batch_is_its_members_and_outside_it_holds_still(degree: int, ends: str) -> None:
    times, values = torch.stack([samples(6, s)[0] for s in (1, 2)]), randn(2, 6, 2)
    t = torch.linspace(-1.0, 9.0, 50, dtype=torch.float64)
    together = Spline(times, values, degree, ends)(t)
    for i in range(2):
        alone = Spline(times[i], values[i], degree, ends)(t)
        for mine, theirs in zip(together.upto(3), alone.upto(3), strict=True):
            torch.testing.assert_close(mine[:, i], theirs, rtol=1e-12, atol=1e-12)
    for now, row in ((0, values[:, 0]), (-1, values[:, -1])):
        assert torch.equal(together.value[now], row)
        assert together.rate is not None and not together.rate[now].any()


def test_thousands_of_samples_are_no_matter() -> None:
    t = torch.arange(3001, dtype=torch.float64) * 0.01
    spline = Spline(t, torch.sin(t).unsqueeze(-1), 5, "clamped", [[1.0], [float(torch.cos(t[-1]))]])
    sample = spline(t[1000:2000] + 0.004)
    assert sample.rate is not None
    wanted = torch.cos(t[1000:2000] + 0.004)
    torch.testing.assert_close(sample.rate[:, 0], wanted, rtol=0, atol=1e-10)


def test_bad_arguments_are_named() -> None:
    times, values = [0.0, 1.0], [[0.0], [1.0]]
    with pytest.raises(mt.ConfigError, match="degree = 4: choose 3 or 5"):
        Spline(times, values, 4)
    with pytest.raises(mt.ConfigError, match="ends = 'free': choose from natural, clamped"):
        Spline(times, values, 3, "free")
    with pytest.raises(mt.ShapeError, match="at least 3 times"):
        Spline(times, values, 5)
    with pytest.raises(mt.ShapeError, match="at least 2 times"):
        Spline(times, [[0.0]])
    with pytest.raises(mt.ConfigError, match=r"Spline times .* must increase"):
        Spline([1.0, 1.0], values)
    with pytest.raises(mt.ConfigError, match=r"Spline values = .* finite"):
        Spline(times, [[0.0], [float("nan")]])
    with pytest.raises(mt.ConfigError, match="end_velocities: not for natural ends"):
        Spline(times, values, end_velocities=0.0)
    with pytest.raises(mt.ConfigError, match="end_accelerations: not for clamped ends of degree 3"):
        Spline(times, values, 3, "clamped", 0.0, 0.0)
    with pytest.raises(mt.ShapeError, match="Spline end_velocities has shape"):
        Spline(times, values, 3, "clamped", [[1.0, 2.0, 3.0]])
