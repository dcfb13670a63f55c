"""Sensors: shifted samples, bit for bit, and readings that are multiples of a quantum."""

from __future__ import annotations

import pytest
import torch
from torch import Tensor

import mann_torch as mt
from mann_torch.signals import Disturbance, Sinusoid
from tests.parts.linear import loop, scenario


def seen_and_read(sensor: mt.Sensor, engine: str, **other: object) -> tuple[Tensor, Tensor]:
    """Plant's state and what came out of the sensor, at the ends of steps of 5 ms."""
    with torch.no_grad():
        run = mt.rollout(
            loop(sensor=sensor), scenario(**other), mt.RungeKutta(5e-3), engine=engine,
            sample_dt=5e-3,
        )  # fmt: skip
    buffer = run.held.sensor.buffer
    return run.states.plant.x, buffer[..., -1, :]


@pytest.mark.parametrize("engine", ["torch", "compiled"])
@pytest.mark.parametrize("periods", [0, 1, 3])
def test_a_delayed_sensor_gives_the_shifted_signal(periods: int, engine: str) -> None:
    """To the last bit; held between samples, and before the first has come, that at t = 0."""
    sensor = mt.Sensor(delay=0.02 * periods, period=0.02)
    start = loop().plant.rest()._replace(x=torch.tensor([[0.3, -0.2], [0.1, 0.4]]).double())
    x, out = seen_and_read(sensor, engine, start=start)
    # What is held at the end of step k was sampled at a start of a step before: tick k // 4.
    for k in range(1, len(x)):
        tick = max((k - 1) // 4 - periods, 0)
        assert torch.equal(out[k], x[4 * tick]), k
    assert float((x[0] - x[-1]).abs().min()) > 0


@pytest.mark.parametrize("engine", ["torch", "compiled"])
def test_what_is_on_its_way_at_first_is_the_noisy_sample(engine: str) -> None:
    noise = mt.MeasurementNoise([0.1, 0.1], 3)
    _, out = seen_and_read(mt.Sensor(delay=0.1, period=0.02), engine, noise=noise)
    assert torch.equal(out[0], out[1]) and torch.equal(out[0], out[20])
    assert float(out[0].abs().min()) > 1e-3  # the plant is at 0
    assert not torch.equal(out[20], out[30])


def test_readings_are_multiples_no_farther_than_half_a_quantum() -> None:
    quantum = torch.tensor([0.1, 0.03], dtype=torch.float64)
    seen = torch.randn(1000, 2, dtype=torch.float64, requires_grad=True)
    read = mt.Sensor(quantum.tolist()).read(seen)
    steps = (read / quantum).round()
    assert torch.equal(read.detach(), steps.detach() * quantum)
    assert float(((read - seen).abs() / quantum).max()) <= 0.5 + 1e-12
    (slope,) = torch.autograd.grad(read.sum(), seen)
    assert torch.equal(slope, torch.ones_like(slope))


def test_a_quantum_a_sample() -> None:
    """Each as in a loop of its own, on both engines, and float64 under `.float()`."""
    quanta = torch.tensor([[0.2], [0.001]], dtype=torch.float64)
    both = mt.Sensor(0.2, period=0.02)
    both.initialize(quantum=quanta)
    for engine in ("torch", "compiled"):
        x, _ = seen_and_read(both, engine)
        for i in range(2):
            alone, _ = seen_and_read(mt.Sensor(float(quanta[i]), period=0.02).float(), engine)
            assert torch.equal(x[:, i], alone)
    assert not torch.equal(x[:, 0], x[:, 1])


def test_widths_that_do_not_fit_are_refused_by_name() -> None:
    with pytest.raises(mt.errors.ShapeError, match="quantum has 3 numbers"):
        mt.rollout(loop(sensor=mt.Sensor([0.1] * 3, period=0.02)), scenario())
    wide = Disturbance(output=Sinusoid([0.1] * 3))
    with pytest.raises(mt.errors.ShapeError, match="disturbance on output has 3 numbers: 2"):
        mt.rollout(loop(), scenario(disturbance=wide))
