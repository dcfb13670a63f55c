"""`check_sensor`: whether a sensor keeps the contract that loops build on."""

from __future__ import annotations

from functools import partial

import torch
from torch import Tensor

from ..checks import instance, whole
from ..parts import Sensor
from ..types import SensorState
from .forms import called, check_held, check_tensor
from .functions import ROUNDING, SAMPLES, Tried, apart, check_function
from .slopes import check_constants
from .telling import broken

#: Clock's period [s] that is tried where a sensor has none of its own.
PERIOD = 0.01


def check_sensor(sensor: Sensor, n_measured: int = 2) -> None:
    """Raise `InterfaceError` where a sensor breaks a line of its contract, which it names.

    Tried on measurements of `n_measured` numbers. Raises `KindError` for what is no `Sensor`,
    `ConfigError` for a number of measurements below 1.
    """
    instance("sensor", sensor, Sensor)
    width = whole("n_measured", n_measured)
    check_held(sensor, 3)
    called(sensor, 4, f"check_fit({width})", partial(sensor.check_fit, width))
    generator = torch.Generator().manual_seed(0)
    seen = torch.randn(SAMPLES, width, generator=generator, dtype=torch.float64)
    found = called(sensor, 1, "read of a batch", lambda: sensor.read(seen))
    check_tensor(sensor, 1, "read", found, seen.shape, "(..., Y)")
    tried = Tried(sensor, 1, "read", _read, [seen])
    check_function(tried)
    check_constants(tried._replace(line=3), 3, gradients=False)
    _check_gradient(sensor, seen)
    _check_still(sensor, seen)


def _read(sensor: Sensor, given: list[Tensor]) -> list[Tensor]:
    return [sensor.read(given[0])]


def _check_gradient(sensor: Sensor, seen: Tensor) -> None:
    """Something comes back, and is finite."""
    x = seen.clone().requires_grad_()
    with torch.enable_grad():
        value = sensor.read(x).sum()
    mend = "add what rounding takes away, detached: what is read has a slope then"
    if not value.requires_grad:
        raise broken(sensor, 1, "no gradient goes through read", mend)
    (slope,) = torch.autograd.grad(value, x, materialize_grads=True)
    if not bool(slope.isfinite().all()):
        mend = "`where` leaks NaN gradients: guard the arguments of what is not chosen"
        raise broken(sensor, 1, "the gradient of read is not finite", mend)
    if not bool((slope != 0).any()):
        raise broken(sensor, 1, "the gradient of read is 0 everywhere", mend)


def _check_still(sensor: Sensor, seen: Tensor) -> None:
    """Of what stands still comes out what is read, at first and after every sample."""
    _, count = called(sensor, 4, f"samples({PERIOD})", partial(sensor.samples, PERIOD))
    state = called(sensor, 2, "initial_state", partial(sensor.initial_state, seen, count))
    if not isinstance(state, SensorState):
        kind = type(state).__name__
        raise broken(sensor, 2, f"initial_state gives a {kind}", "return a SensorState")
    wanted, shape = sensor.read(seen), state.buffer.shape
    for k in range(min(count, SAMPLES) + 2):
        out = called(sensor, 2, "output", partial(sensor.output, state))
        check_tensor(sensor, 2, "output", out, seen.shape, "(..., Y)")
        if apart([out], [wanted]) > ROUNDING:
            found = f"after {k} samples of one and the same, something else comes out than is read"
            raise broken(sensor, 2, found, "begin with samples as they are read at t = 0")
        state = called(sensor, 2, "forward", partial(sensor.forward, seen, state))
        if state.buffer.shape != shape:
            found = f"forward gives a buffer {tuple(state.buffer.shape)}, not {tuple(shape)}"
            raise broken(sensor, 2, found, "its form stays")
