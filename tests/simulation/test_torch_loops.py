"""Scorecard G5: why the time loop is neither torch.while_loop nor torch's scan. Canaries."""

from __future__ import annotations

from collections.abc import Callable

import pytest
import torch
from torch import Tensor
from torch._higher_order_ops import scan

STEPS = 7
A = 0.3 * torch.randn(3, 3, generator=torch.Generator().manual_seed(0), dtype=torch.float64)


def step(y: Tensor, a: Tensor) -> Tensor:
    return torch.tanh(a * (A @ y) + 0.1)


def by_python(y: Tensor, a: Tensor) -> Tensor:
    for _ in range(STEPS):
        y = step(y, a)
    return y


def by_scan(y: Tensor, a: Tensor) -> Tensor:
    rows = torch.zeros(STEPS, dtype=torch.float64)
    return scan(lambda y, _: (step(y, a), y.clone()), y, rows)[0]


def by_while_loop(y: Tensor, a: Tensor) -> Tensor:
    def more(k: Tensor, y: Tensor) -> Tensor:
        return k < STEPS

    def body(k: Tensor, y: Tensor) -> tuple[Tensor, Tensor]:
        return k + 1, step(y, a)

    return torch.while_loop(more, body, (torch.tensor(0), y))[1]


def gradients(run: Callable[[Tensor, Tensor], Tensor], free: bool) -> tuple[Tensor, list[Tensor]]:
    """The end, and its slopes: along a and, where the start is free, along it too."""
    a = torch.tensor(0.7, dtype=torch.float64, requires_grad=True)
    y = torch.linspace(0.2, 0.9, 3, dtype=torch.float64).requires_grad_(free)
    end = run(y, a)
    return end, list(torch.autograd.grad(end.square().sum(), [a, y] if free else [a]))


def check(run: Callable[[Tensor, Tensor], Tensor], free: bool) -> None:
    end, slopes = gradients(run, free)
    expected_end, expected = gradients(by_python, free)
    torch.testing.assert_close(end, expected_end, rtol=1e-14, atol=0)
    for slope, right in zip(slopes, expected, strict=True):
        torch.testing.assert_close(slope, right, rtol=1e-13, atol=0)


@pytest.mark.slow
@pytest.mark.parametrize("free", [False, True])
def test_scan_is_a_python_loop(free: bool) -> None:
    check(by_scan, free)


@pytest.mark.slow
def test_while_loop_is_a_python_loop_from_a_start_that_asks_for_a_gradient() -> None:
    check(by_while_loop, free=True)


@pytest.mark.slow
@pytest.mark.xfail(
    strict=True,
    raises=AssertionError,
    reason="torch.while_loop's gradient is wrong, without a word, where the start asks for none. "
    "If this passes, torch has mended it: drop this mark and the test below.",
)
def test_while_loop_is_a_python_loop_from_any_start() -> None:
    check(by_while_loop, free=False)


@pytest.mark.slow
def test_what_while_loop_gives_instead() -> None:
    """The value is right, and so nothing tells: the slope is off by tens of percent."""
    (end, (slope,)), (right_end, (right,)) = (
        gradients(run, False) for run in (by_while_loop, by_python)
    )
    assert torch.equal(end, right_end)
    if torch.allclose(slope, right, rtol=1e-9, atol=0):
        pytest.skip(f"torch {torch.__version__} has mended torch.while_loop")
    assert abs(float(slope / right) - 1.0) > 0.05
