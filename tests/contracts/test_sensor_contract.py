"""Every sensor keeps its contract, and `check_sensor` refuses what does not."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest
import torch

import mann_torch as mt
from mann_torch.errors import InterfaceError
from mann_torch.parts import Sensor
from mann_torch.testing import check_sensor
from mann_torch.types import SensorState


@pytest.mark.parametrize(
    ("sensor", "width"),
    [
        (Sensor(), 1),
        (Sensor(0.1, delay=0.03), 4),
        (Sensor([0.1, 0.2, 0.3], delay=0.02, period=0.02), 3),
    ],
)
def test_a_sensor_of_the_library_keeps_its_contract(sensor: Sensor, width: int) -> None:
    check_sensor(sensor, width)


def reading(read: Callable[[Any, torch.Tensor], Any]) -> Sensor:
    """A sensor that reads so."""
    return type("Broken", (Sensor,), {"read": read})(0.1)


def holding(**members: Any) -> Sensor:
    """A sensor with other members."""
    return type("Broken", (Sensor,), members)(0.1)


def held(name: str, value: Any) -> Sensor:
    """A sensor that holds something."""
    sensor = Sensor(0.1)
    object.__setattr__(sensor, name, value)
    return sensor


BROKEN: dict[str, tuple[Callable[[], Sensor], str]] = {
    "a number for a row": (
        lambda: reading(lambda self, seen: seen.sum(-1)),
        r"line 1: read has shape \(8,\), not \(8, 2\)",
    ),
    "float32": (lambda: reading(lambda self, seen: seen.float()), "line 1: read is torch.float32"),
    "samples that mix": (
        lambda: reading(lambda self, seen: seen + seen.mean()),
        "line 1: sample 0 of a batch has another read",
    ),
    "a random number": (
        lambda: reading(lambda self, seen: seen + torch.randn_like(seen)),
        "line 1: read gives other numbers for the same arguments",
    ),
    "a decision in Python": (
        lambda: reading(lambda self, seen: seen if bool(seen.sum() > 0) else seen * 1.0),
        "line 1: read under torch.func.vmap fails; a decision on data",
    ),
    "stairs without a slope": (
        lambda: reading(lambda self, seen: torch.round(seen / 0.1) * 0.1),
        "line 1: the gradient of read is 0 everywhere",
    ),
    "detached": (
        lambda: reading(lambda self, seen: seen.detach() + 1.0),
        "line 1: no gradient goes through read",
    ),
    "a gradient that is no number": (
        lambda: reading(lambda self, seen: torch.where(seen > 0, seen.sqrt(), seen)),
        "line 1: the gradient of read is not finite",
    ),
    "a start of zeros": (
        lambda: holding(
            initial_state=lambda self, seen, count: SensorState(
                seen.new_zeros(*seen.shape[:-1], count + 1, seen.shape[-1])
            )
        ),
        "line 2: after 0 samples of one and the same, something else comes out",
    ),
    "a start that is no state": (
        lambda: holding(initial_state=lambda self, seen, count: seen),
        "line 2: initial_state gives a Tensor",
    ),
    "a buffer that grows": (
        lambda: holding(
            forward=lambda self, seen, state: SensorState(
                torch.cat([self.read(seen).unsqueeze(-2), state.buffer], dim=-2)
            )
        ),
        r"line 2: forward gives a buffer \(8, 2, 2\), not \(8, 1, 2\)",
    ),
    "a tensor of its own": (
        lambda: held("bias", torch.ones(2, dtype=torch.float64)),
        "line 3: bias is a tensor that is not registered",
    ),
    "a constant beside the batch": (
        lambda: reading(lambda self, seen: seen * self.quantum.sum()),
        "line 3: read with the constant quantum of shape .* does not give each sample its own",
    ),
    "another width": (lambda: Sensor([0.1, 0.2, 0.3]), r"line 4: check_fit\(2\) fails"),
}


@pytest.mark.parametrize("name", BROKEN)
def test_a_broken_sensor_is_refused_by_what_is_wrong(name: str) -> None:
    make, told = BROKEN[name]
    with pytest.raises(InterfaceError, match=rf"^\w+, contract .*(?:{told})"):
        check_sensor(make())


def test_what_is_no_sensor_is_named() -> None:
    with pytest.raises(mt.KindError, match="sensor = 3"):
        check_sensor(3)  # type: ignore[arg-type]
