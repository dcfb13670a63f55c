"""Rows: what expands, selects and stacks, and what is refused."""

import pytest
import torch

import mann_torch as mt
from mann_torch.signals import Disturbance, Polynomial, Sinusoid, SmoothSteps, Steps, Sum
from tests.conftest import randn

T = torch.linspace(0.0, 5.0, 11, dtype=torch.float64)


def test_a_batch_is_its_members() -> None:
    rows = randn(4, 3, 2)
    batch = Polynomial(rows)
    for i in range(4):
        assert torch.equal(batch(T).value[:, i], Polynomial(rows[i])(T).value)
    chosen = batch.select([2, -1])
    assert torch.equal(chosen(T).value, batch(T).value[:, [2, 3]])
    stacked = batch.stack([Polynomial(rows[i]) for i in range(4)])
    assert torch.equal(stacked(T).jerk, batch(T).jerk)  # type: ignore[arg-type]
    own = batch.aligned(T[:4]).value
    assert torch.equal(own, torch.stack([batch(T[:4]).value[i, i] for i in range(4)]))


def test_steps_of_unlike_number_stack_and_smooth_ones_say_why_not() -> None:
    one, two = Steps([1.0], [[0.0], [1.0]]), Steps([1.0, 2.0], [[0.0], [1.0], [2.0]])
    both = one.stack([one, two])
    assert both(T).value[-1, :, 0].tolist() == [1.0, 2.0]
    a = SmoothSteps([1.0], [[0.0], [1.0]], 1.0)
    b = SmoothSteps([1.0, 2.0], [[0.0], [1.0], [2.0]], 1.0)
    with pytest.raises(mt.ConfigError, match="SmoothSteps: only those alike"):
        a.stack([a, b])


def test_what_does_not_fit_is_named() -> None:
    line = Polynomial([[1.0], [2.0]])
    with pytest.raises(mt.ConfigError, match="give at least one to stack"):
        line.stack([])
    with pytest.raises(mt.KindError, match="Polynomial"):
        line.stack([Sinusoid([1.0])])
    with pytest.raises(mt.ShapeError, match=r"batch shape \(\): it has no members \[0\]"):
        line.select([0])
    with pytest.raises(mt.ShapeError, match=r"it has no members \[0, 3\]"):
        line.expand((3,)).select([0, 3])
    with pytest.raises(mt.ShapeError, match=r"batch shape \(3,\) does not expand to \(2,\)"):
        line.expand((3,)).expand((2,))
    with pytest.raises(mt.ConfigError, match=r"Polynomial coefficients = .* finite"):
        Polynomial([[float("inf")]])
    with pytest.raises(mt.ShapeError, match=r"Polynomial coefficients has shape \(1,\)"):
        Polynomial([1.0])


def test_parts_of_a_sum_go_along() -> None:
    total = Sum([Polynomial(randn(4, 2, 2)), Sinusoid([1.0, 2.0])])
    assert total.batch_shape == (4,) and total.select([1]).batch_shape == (1,)
    assert torch.equal(total.select([1])(T).value[:, 0], total(T).value[:, 1])
    pair = total.stack([total, total])
    assert torch.equal(pair(T).rate[:, 1], total(T).rate)  # type: ignore[index, arg-type]


def test_a_part_that_is_there_twice_goes_along_twice() -> None:
    wave = Sinusoid([1.0, 2.0])
    wide = Disturbance(input=wave, output=wave).expand((3,))(T)
    assert wide.input is not None and wide.output is not None
    assert wide.input.shape == wide.output.shape == (11, 3, 2)
    double = Sum([wave, wave]).expand((3,))
    assert torch.equal(double(T).value[:, 1], 2.0 * wave(T).value)
