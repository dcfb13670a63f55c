"""Wing rock: its equations, and the limit cycle that Elzebda, Nayfeh and Mook published."""

from __future__ import annotations

import math

import numpy as np
import pytest
import torch
from scipy.integrate import solve_ivp

from mann_torch.plants import CHOWDHARY_JOHNSON, ELZEBDA, RowState, WingRock
from mann_torch.stiff import FirstOrderBlock
from mann_torch.types import InputGains
from tests.conftest import randn
from tests.plants.motion import rate_of


def test_weights_are_the_problems() -> None:
    assert CHOWDHARY_JOHNSON == (0.8, 0.2314, 0.6918, -0.6245, 0.0095, 0.0214)
    published = (-18.59521, 15.162375, -62.45153, 9.54708, 21.45291)
    assert list(ELZEBDA) == pytest.approx([0.0, *(1e-3 * a for a in published)], rel=1e-14)
    assert WingRock().parameters_of().weights.tolist() == list(CHOWDHARY_JOHNSON)


def test_equations_are_the_problems() -> None:
    wing = WingRock()
    x_1, x_2, u = -0.7, 0.4, 0.3
    w = CHOWDHARY_JOHNSON
    moment = w[0] + w[1] * x_1 + w[2] * x_2 + w[3] * 0.7 * x_2 + w[4] * 0.4 * x_2 + w[5] * x_1**3
    state = RowState(torch.tensor([x_1, x_2], dtype=torch.float64))
    input = wing.grouped(torch.tensor([u], dtype=torch.float64))
    rate = wing.derivative(torch.zeros(()), state, input, None, wing.parameters_of())
    assert rate.x.tolist() == pytest.approx([x_2, u + moment], rel=1e-14)


def test_limit_cycle_has_the_published_amplitude_and_period() -> None:
    """From inside and from outside; located where the rate, or the angle, is 0.

    The benchmarks' note prints a period of 56.1374, 1.3e-4 more than its own equations have: SciPy
    and NumPy alone give 56.137270596 and an amplitude of 0.6075624658 from four starts.
    """
    wing = WingRock()
    _, rate = rate_of(wing, wing.parameters_of(weights=ELZEBDA), lambda t: [0.0])

    def peak(t: float, x: np.ndarray) -> float:
        return x[1]

    def crossing(t: float, x: np.ndarray) -> float:
        return x[0]

    peak.direction, crossing.direction = -1.0, 1.0  # type: ignore[attr-defined]
    for start in (0.605, 0.61):
        solved = solve_ivp(
            rate,
            (0.0, 1700.0),
            [start, 0.0],
            method="DOP853",
            rtol=1e-11,
            atol=1e-13,
            events=(peak, crossing),
        )
        assert solved.success
        amplitudes, period = solved.y_events[0][:, 0], np.diff(solved.t_events[1])
        # Drawn to the cycle: what is missing shrinks from turn to turn.
        away = np.abs(amplitudes - 0.6075624658)
        assert away[-1] < 1e-4 * away[0]
        assert amplitudes[-1] == pytest.approx(0.6075624658, abs=1e-9)
        assert period[-1] == pytest.approx(56.137270596, abs=1e-7)


@pytest.mark.parametrize("accelerometer", [False, True])
def test_the_block_is_the_loops_jacobian(accelerometer: bool) -> None:
    wing, x = WingRock(accelerometer), randn(6, 2)
    gain = randn(6, 1, 3 if accelerometer else 2, seed=1)
    p, t = wing.parameters_of(), torch.zeros(6, dtype=torch.float64)

    def rate(x: torch.Tensor) -> torch.Tensor:
        seen = torch.cat(list(wing.measure(RowState(x), p)), dim=-1)
        u = wing.grouped(-(gain @ seen.unsqueeze(-1))[..., 0])
        return wing.derivative(t, RowState(x), u, None, p).x

    full = torch.func.jacrev(rate)(x)
    own = torch.stack([full[i, :, i] for i in range(6)])
    gains = InputGains(gain, randn(6, 1, seed=2))
    u = wing.grouped(torch.zeros(6, 1, dtype=torch.float64))
    _, block = wing.linearized(t, RowState(x), u, None, p, gains)
    assert isinstance(block, FirstOrderBlock)
    torch.testing.assert_close(block.jacobian, own, rtol=1e-12, atol=1e-12)
    assert torch.equal(block.drift[..., 1:], gains.drift) and not block.drift[..., 0].any()


def test_the_origin_rests_without_the_constant_weight_only() -> None:
    wing, t = WingRock(), torch.zeros((), dtype=torch.float64)
    still = wing.grouped(torch.zeros(1, dtype=torch.float64))
    rates = [
        wing.derivative(t, wing.rest(), still, None, wing.parameters_of(weights=w)).x.tolist()
        for w in (ELZEBDA, CHOWDHARY_JOHNSON)
    ]
    assert rates[0] == [0.0, 0.0] and math.isclose(rates[1][1], 0.8)


def test_the_accelerometer_shows_the_moment() -> None:
    wing, x = WingRock(accelerometer=True), randn(6, 2)
    p = wing.parameters_of()
    seen = wing.measure(RowState(x), p)
    rate = wing.derivative(
        torch.zeros(6, dtype=torch.float64), RowState(x), wing.grouped(randn(6, 1)), None, p
    )
    assert torch.equal(seen.x, x)
    torch.testing.assert_close(seen.moment, rate.x[..., 1:] - randn(6, 1), rtol=0, atol=1e-14)
