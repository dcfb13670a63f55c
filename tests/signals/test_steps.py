"""What jumps: steps and square waves."""

import math

import pytest
import torch

import mann_torch as mt
from mann_torch.signals import SquareWave, Steps


def at(*times: float) -> torch.Tensor:
    return torch.tensor(times, dtype=torch.float64)


def test_the_pulses_of_problem_4() -> None:
    times = [5.0, 10.0, 20.0, 25.0, 35.0, 40.0, 50.0, 60.0]
    pulses = Steps(times, [[float(k % 2)] for k in range(9)])
    t = at(0.0, 4.999, 5.0, 9.999, 10.0, 20.0, 25.0, 37.0, 45.0, 55.0, 61.0)
    assert pulses(t).value[:, 0].tolist() == [0, 0, 1, 1, 0, 1, 0, 1, 0, 1, 0]
    assert pulses(t).parts[1:] == (None,) * 4


def test_the_square_wave_of_problem_6_is_plus_first() -> None:
    wave = SquareWave([1.0], 20.0)
    t = at(0.0, 9.999, 10.0, 19.999, 20.0, 29.999, 30.0, 99.0)
    assert wave(t).value[:, 0].tolist() == [1, 1, -1, -1, 1, 1, -1, -1]


def test_offset_phase_and_negative_amplitude() -> None:
    wave = SquareWave([2.0, -2.0], 4.0, [1.0, 0.0], [math.pi, 0.0])
    assert wave(at(0.0, 2.0, 3.9, 4.0)).value.tolist() == [[-1, -2], [3, 2], [3, 2], [-1, -2]]
    t = torch.arange(0, 4000, dtype=torch.float64) / 1000
    torch.testing.assert_close(wave(t).value.mean(dim=0), at(1.0, 0.0), rtol=0, atol=1e-15)


def test_gradients_reach_the_values_in_force() -> None:
    values = torch.tensor([[1.0], [2.0]], dtype=torch.float64, requires_grad=True)
    amplitude = torch.tensor([1.5], dtype=torch.float64, requires_grad=True)
    Steps([1.0], values)(at(0.0, 2.0, 3.0)).value.sum().backward()
    SquareWave(amplitude, 2.0)(at(0.0, 0.5, 1.5)).value.sum().backward()
    assert values.grad is not None and values.grad.tolist() == [[1.0], [2.0]]
    assert amplitude.grad is not None and amplitude.grad.tolist() == [1.0]


def test_bad_arguments_are_named() -> None:
    with pytest.raises(mt.ConfigError, match=r"times .* must increase"):
        Steps([2.0, 1.0], [[0.0], [1.0], [2.0]])
    with pytest.raises(mt.ConfigError, match=r"Steps values .* finite"):
        Steps([1.0], [[0.0], [float("nan")]])
    with pytest.raises(mt.ShapeError, match="one value row more"):
        Steps([1.0], [[0.0]])
    with pytest.raises(mt.ConfigError, match=r"SquareWave period .* > 0"):
        SquareWave([1.0], 0.0)
    with pytest.raises(mt.ShapeError, match="SquareWave: give at least one"):
        SquareWave(1.0, 2.0)
