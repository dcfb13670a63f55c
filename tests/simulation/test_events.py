"""Located events against derivatives worked out by hand."""

from __future__ import annotations

import math
from collections.abc import Callable

import pytest
import torch
from torch import Tensor

from tests.simulation.toys import Toy

ZERO = torch.zeros((), dtype=torch.float64)


def number(value: float) -> Tensor:
    return torch.tensor(value, dtype=torch.float64)


def steps(end: float, dt: float) -> Tensor:
    n = round(end / dt)
    return end * torch.arange(n + 1, dtype=torch.float64) / n


def switch(a: Tensor, b: float = 3.0) -> Toy:
    """x' = a below 1, b above: x(T) = 1 + b (T - 1/a), dx(T)/da = b / a^2."""
    return Toy([a, number(b)], [ZERO, ZERO], number(1.0))


def reset(a: Tensor, c: float = 0.6, gain: float = 0.5, k: float = 1.0) -> Toy:
    """x' = a - k x from 0; at c, x jumps to gain c."""
    return Toy([a], [number(k)], number(c), number(gain))


def reset_slope(a: float, end: float, c: float = 0.6, gain: float = 0.5) -> float:
    """dx(T)/da after one reset, k = 1.

    It comes at tau = ln(a / (a - c)); x(T) = a + (gain c - a) e^(tau - T), and e^tau = a / (a - c).
    """
    inner = -a / (a - c) - c * (gain * c - a) / (a - c) ** 2
    return 1.0 + math.exp(-end) * inner


def reverse(function: Callable[[Tensor], Tensor], at: float) -> float:
    a = number(at).requires_grad_(True)
    return float(torch.autograd.grad(function(a), a)[0])


def forward(function: Callable[[Tensor], Tensor], at: float) -> float:
    return float(torch.func.jvp(function, (number(at),), (number(1.0),))[1])


#: x(T) in closed form.
VALUES = {
    "switch": lambda a, end: 1.0 + 3.0 * (end - 1.0 / a),
    "reset": lambda a, end: a + (0.3 - a) * a / (a - 0.6) * math.exp(-end),
}
CASES = {
    "switch": (switch, 0.9, 2.0, 3.0 / 0.81),
    "reset": (reset, 0.9, 1.5, reset_slope(0.9, 1.5)),
}


engines = pytest.mark.parametrize("engine", ["torch", "compiled"])
DERIVATIVES = {
    "reverse": (reverse, "torch"),
    "forward": (forward, "torch"),
    "compiled": (reverse, "compiled"),
}


@pytest.mark.parametrize("way", list(DERIVATIVES))
@pytest.mark.parametrize("dt", [0.3, 0.01])
@pytest.mark.parametrize("name", list(CASES))
def test_the_derivative_is_the_one_by_hand(name: str, dt: float, way: str) -> None:
    toy, at, end, expected = CASES[name]
    derivative, engine = DERIVATIVES[way]
    value, _, counts = toy(number(at)).run(ZERO, steps(end, dt), engine)
    assert [int(c) for c in counts] == [1, 0, 0]
    assert abs(float(value) - VALUES[name](at, end)) <= 1e-8
    found = derivative(lambda a: toy(a).run(ZERO, steps(end, dt), engine)[0], at)
    assert abs(found - expected) <= 1e-8


def test_second_derivatives_go_through_the_events_time() -> None:
    """x(T) = 1 + 3 (T - 1/a): d2x/da2 = -6 / a^3; after a reset against differences."""
    for name, expected in (("switch", -6.0 / 0.9**3), ("reset", None)):
        toy, at, end, _ = CASES[name]
        if expected is None:
            slopes = [reset_slope(at + step, end) for step in (1e-5, -1e-5)]
            expected = (slopes[0] - slopes[1]) / 2e-5
        a = number(at).requires_grad_(True)
        value = toy(a).run(ZERO, steps(end, 0.3))[0]
        (first,) = torch.autograd.grad(value, a, create_graph=True)
        (second,) = torch.autograd.grad(first, a)
        assert abs(float(second) - expected) <= 1e-6 * abs(expected)


@pytest.mark.parametrize("name", list(CASES))
def test_canary_plain_differentiation_is_wrong_at_every_step(name: str) -> None:
    toy, at, end, expected = CASES[name]
    for dt in (0.1, 0.01, 0.001):
        plain = reverse(lambda a, dt=dt: toy(a).run_plainly(ZERO, steps(end, dt)), at)
        assert abs(plain - expected) > 0.05
    if name == "switch":
        assert abs(plain - 1.11) < 0.01


@engines
@pytest.mark.parametrize("ulps", [-3, -1, 0, 1, 3])
@pytest.mark.parametrize("name", list(CASES))
def test_an_event_on_a_step_end_is_not_lost(name: str, ulps: int, engine: str) -> None:
    toy, at, end, expected = CASES[name]
    tau = 1.0 / at if name == "switch" else math.log(at / (at - 0.6))
    for _ in range(abs(ulps)):
        tau = math.nextafter(tau, math.copysign(math.inf, ulps))
    times = torch.tensor([0.0, 0.5 * tau, tau, 0.5 * (tau + end), end], dtype=torch.float64)
    counts = toy(number(at)).run(ZERO, times, engine)[2]
    assert int(counts.located) == 1 and int(counts.unresolved) == 0
    found = reverse(lambda a: toy(a).run(ZERO, times, engine)[0], at)
    assert abs(found - expected) <= 1e-8
    # An output at the event's own time is the state there; its slope is of one side.
    there = float(toy(number(at)).run(ZERO, times[:3], engine)[0])
    sides = (1.0, 1.0) if name == "switch" else (0.6, 0.3)
    assert min(abs(there - side) for side in sides) < 1e-12


@engines
def test_two_resets_in_neighbouring_steps_and_two_in_one(engine: str) -> None:
    """x' = a from 0, to 0 at c = 0.1: x(T) = a T - n c, so that dx(T)/da = T."""

    def toy(a: Tensor) -> Toy:
        return Toy([a], [ZERO], number(0.1), number(0.0))

    times = torch.tensor([0.0, 0.09, 0.12, 0.21, 0.24], dtype=torch.float64)
    value, mode, counts = toy(number(1.0)).run(ZERO, times, engine)
    assert [int(c) for c in counts] == [2, 0, 0] and int(mode.reallocations) == 2
    assert abs(float(value) - 0.04) < 1e-12
    assert abs(reverse(lambda a: toy(a).run(ZERO, times, engine)[0], 1.0) - 0.24) <= 1e-8
    times = torch.tensor([0.0, 0.25, 0.26], dtype=torch.float64)
    value, mode, counts = toy(number(1.0)).run(ZERO, times, engine)
    assert [int(c) for c in counts] == [1, 0, 1] and int(mode.reallocations) == 2


@engines
def test_a_batch_is_its_samples(engine: str) -> None:
    a = torch.tensor([0.55, 0.9, 1.3, 2.1, 0.2], dtype=torch.float64, requires_grad=True)
    b = number(3.0)
    for make in (
        lambda a: Toy([a, b], [ZERO, ZERO], number(1.0)),
        lambda a: Toy([a], [number(1.0)], number(0.6), number(0.5)),
    ):
        values, _, counts = make(a).run(torch.zeros(5).double(), steps(2.0, 0.25), engine)
        (together,) = torch.autograd.grad(values.sum(), a)
        assert torch.isfinite(together).all() and counts.located[-1] == 0
        for i in range(5):
            single = a.detach()[i].requires_grad_(True)
            value, _, count = make(single).run(ZERO, steps(2.0, 0.25), engine)
            (own,) = torch.autograd.grad(value, single)
            assert int(count.located) == int(counts.located[i])
            torch.testing.assert_close(values[i], value, rtol=1e-12, atol=0)
            torch.testing.assert_close(together[i], own, rtol=1e-12, atol=0)


@engines
def test_a_sliding_mode_is_averaged_and_counted(engine: str) -> None:
    """x' = 1 below 1 and -2 above: from 1 on x stays there, whatever the slopes."""

    def toy(a: Tensor) -> Toy:
        return Toy([a, number(-2.0)], [ZERO, ZERO], number(1.0))

    value, _, counts = toy(number(1.0)).run(ZERO, steps(2.0, 0.03), engine)
    assert abs(float(value) - 1.0) < 1e-12 and int(counts.located) == 0
    assert int(counts.sliding) > 30 and int(counts.unresolved) == 0
    assert abs(reverse(lambda a: toy(a).run(ZERO, steps(2.0, 0.03), engine)[0], 1.0)) < 1e-10
    assert abs(reverse(lambda a: toy(a).run_plainly(ZERO, steps(2.0, 0.03)), 1.0)) > 0.5


@engines
def test_a_grazing_state_divides_by_nothing(engine: str) -> None:
    """x' = 0.5 - x reaches its limit, 0.5, never: no event, and no NaN close to it."""
    for c in (0.5, 0.5 - 1e-14, math.nextafter(0.5, 0.0)):
        a = number(0.5).requires_grad_(True)
        value, _, _ = reset(a, c=c).run(ZERO, steps(40.0, 0.5), engine)
        (slope,) = torch.autograd.grad(value, a)
        assert bool(torch.isfinite(value)) and bool(torch.isfinite(slope))
