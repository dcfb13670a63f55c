"""Polynomials, and references added up: the reference of problem 1."""

import math

import pytest
import torch

import mann_torch as mt
from mann_torch.signals import Polynomial, Sinusoid, Sinusoids, Steps, Sum


def test_a_polynomial_and_its_derivatives_in_closed_form() -> None:
    t = torch.linspace(-2.0, 3.0, 26, dtype=torch.float64)
    sample = Polynomial([[1.0], [-2.0], [0.5], [0.25]])(t)
    rows = [
        1 - 2 * t + 0.5 * t**2 + 0.25 * t**3,
        -2 + t + 0.75 * t**2,
        1 + 1.5 * t,
        1.5 + 0 * t,
        0 * t,
    ]
    for part, wanted in zip(sample.upto(4), rows, strict=True):
        torch.testing.assert_close(part[:, 0], wanted, rtol=0, atol=1e-13)


def test_a_constant_stands_still() -> None:
    sample = Polynomial([[3.0, -1.0]])(torch.arange(4, dtype=torch.float64))
    assert sample.value.tolist() == [[3.0, -1.0]] * 4
    assert not any(part.any() for part in sample.upto(4)[1:])


def test_the_quadrotors_reference_of_problem_1() -> None:
    """x = 2 sin wt + 4t/T, y = 3(1 - cos wt), phi = 4 pi/3 (t/T)(1 - t/T)."""
    T, w = 10.0, 2 * math.pi / 10.0
    bend = 4 * math.pi / 3
    path = Sum(
        [
            Sinusoids([[2.0, -3.0, 0.0]], w, [[0.0, math.pi / 2, 0.0]], [0.0, 3.0, 0.0]),
            Polynomial([[0.0, 0.0, 0.0], [4 / T, 0.0, bend / T], [0.0, 0.0, -bend / T**2]]),
        ]
    )
    t = torch.linspace(0.0, T, 101, dtype=torch.float64)
    sample, u, zero = path(t), t / T, 0 * t
    sin, cos = torch.sin(w * t), torch.cos(w * t)
    rows = [
        [2 * sin + 4 * u, 3 * (1 - cos), bend * u * (1 - u)],
        [2 * w * cos + 4 / T, 3 * w * sin, bend / T * (1 - 2 * u)],
        [-2 * w**2 * sin, 3 * w**2 * cos, -2 * bend / T**2 + zero],
        [-2 * w**3 * cos, -3 * w**3 * sin, zero],
        [2 * w**4 * sin, -3 * w**4 * cos, zero],
    ]
    for part, wanted in zip(sample.upto(4), rows, strict=True):
        torch.testing.assert_close(part, torch.stack(wanted, dim=-1), rtol=0, atol=1e-14)
    assert path(t[50]).value.tolist() == pytest.approx([2.0, 6.0, math.pi / 3], abs=1e-14)


def test_a_sum_has_the_derivatives_that_all_parts_have() -> None:
    both = Sum([Sinusoid([1.0]), Steps([1.0], [[0.0], [2.0]])])
    t = torch.tensor([0.5, 1.0], dtype=torch.float64)
    assert both.order == 0 and both(t).parts[1:] == (None,) * 4
    torch.testing.assert_close(both(t).value - Sinusoid([1.0])(t).value, t.new_tensor([[0], [2]]))


def test_bad_arguments_are_named() -> None:
    with pytest.raises(mt.ConfigError, match="at least one"):
        Sum([])
    with pytest.raises(mt.ShapeError, match=r"widths \[1, 2\]"):
        Sum([Polynomial([[1.0]]), Polynomial([[1.0, 2.0]])])
    with pytest.raises(mt.KindError, match=r"parts\[1\]"):
        Sum([Polynomial([[1.0]]), 2.0])  # type: ignore[list-item]
    with pytest.raises(mt.ShapeError, match=r"Sum: batch shapes .* do not broadcast"):
        Sum([Polynomial([[1.0]]).expand((2,)), Polynomial([[1.0]]).expand((3,))])
    with pytest.raises(mt.ShapeError, match="at least one row"):
        Polynomial(torch.zeros(0, 2, dtype=torch.float64))
