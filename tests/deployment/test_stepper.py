"""A deployed controller's steps: what they keep, refuse, hold and save."""

from __future__ import annotations

import math

import pytest
import torch
from torch import Tensor

import mann_torch as mt
from mann_torch.deployment import DIVERGED, REFUSED, SATURATED
from mann_torch.errors import DtypeError, KindError, RecordError, ShapeError
from tests.conftest import make_controller

PERIOD = 1e-3


def bits(x: Tensor) -> bytes:
    """Integers among a state's numbers are NaN as such."""
    return x.numpy().tobytes()


def rows(seed: int, dtype: torch.dtype = torch.float64) -> tuple[Tensor, Tensor]:
    """A reference and a measurement of two joints."""
    g = torch.Generator().manual_seed(seed)
    return torch.randn(6, generator=g).to(dtype), torch.randn(4, generator=g).to(dtype)


def made(name: str = "reallocating_initial", **options: object) -> mt.Stepper:
    return mt.deploy(make_controller(name), PERIOD, **{"engine": "torch", **options})


@pytest.fixture(scope="module")
def compiled() -> mt.Stepper:
    return mt.deploy(make_controller("reallocating_initial"), PERIOD)


def after(stepper: mt.Stepper, count: int) -> Tensor:
    state = stepper.initial_state(*rows(0, stepper.dtype))
    for k in range(count):
        _, state = stepper(state, *rows(k, stepper.dtype))
    return state


def test_state_goes_in_and_out(compiled: mt.Stepper) -> None:
    state = after(compiled, 3)
    before = bits(state)
    first, again = (compiled(state, *rows(9)) for _ in range(2))
    assert bits(state) == before
    assert bits(first[0]) == bits(again[0]) and bits(first[1]) == bits(again[1])
    assert first[1].shape == (compiled.size,)


def test_samples_and_rows_are_the_same(compiled: mt.Stepper) -> None:
    reference, measurement = rows(4)
    sample = mt.ReferenceSample(*reference.split(2))
    seen = mt.types.Measurement(*measurement.split(2))
    state = after(compiled, 2)
    whole = compiled(state, sample, seen), compiled(state, reference, measurement)
    assert bits(whole[0][1]) == bits(whole[1][1])
    assert bits(compiled.initial_state(sample, seen)) == bits(compiled.initial_state(*rows(4)))


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
def test_what_is_not_finite_is_refused_and_changes_nothing(
    compiled: mt.Stepper, value: float
) -> None:
    state = after(compiled, 3)
    before, command = bits(state), compiled.unpacked(state).input
    for where in range(10):
        reference, measurement = rows(5)
        (reference if where < 6 else measurement)[where % 6] = value
        u, kept, flags = compiled.step(state, reference, measurement)
        assert flags == REFUSED
        assert bits(kept) == before and torch.equal(u, command)
    assert compiled.step(state, *rows(5)).flags == 0


def test_what_would_overflow_is_refused(compiled: mt.Stepper) -> None:
    state = after(compiled, 3)
    reference, measurement = rows(5)
    u, kept, flags = compiled.step(state, reference, measurement * 1e200)
    assert flags == DIVERGED
    assert bits(kept) == bits(state) and torch.equal(u, compiled.unpacked(state).input)


@pytest.mark.parametrize("engine", ["torch", "compiled"])
def test_the_command_stays_within_limits(engine: str) -> None:
    limit = mt.Actuator(2, limit=[2.0, 500.0])
    stepper = made("nn", engine=engine, actuator=limit)
    reference, measurement = rows(1)
    state = stepper.initial_state(reference, measurement)
    u, state, flags = stepper.step(state, reference, measurement)
    free = made("nn").step(made("nn").initial_state(reference, measurement), reference, measurement)
    assert abs(free.input[0]) > 2.0 > abs(float(u[0])) - 1e-15 and flags == SATURATED
    assert u[1] == pytest.approx(float(free.input[1]), rel=1e-12)


def test_frozen_it_stands_still_and_goes_on_from_there(compiled: mt.Stepper) -> None:
    state = after(compiled, 5)
    frozen = state
    for k in range(3):
        _, frozen = compiled(frozen, *rows(20 + k), adapt=False)
    one, other = (compiled.unpacked(x).controller for x in (state, frozen))
    for name in ("W", "b_w", "V", "b_v"):
        assert torch.equal(getattr(one.network, name), getattr(other.network, name))
    assert torch.equal(one.memory.mu, other.memory.mu)
    _, learned = compiled(frozen, *rows(30))
    assert not torch.equal(compiled.unpacked(learned).controller.network.W, one.network.W)


@pytest.mark.parametrize("dtype", [torch.float64, torch.float32])
def test_a_state_as_bytes_goes_on_elsewhere(dtype: torch.dtype) -> None:
    stepper, other = made(dtype=dtype), made(dtype=dtype)
    state = after(stepper, 3)
    again = other.from_bytes(stepper.to_bytes(state))
    for one, two in zip(
        stepper.step(state, *rows(7, dtype)), other.step(again, *rows(7, dtype)), strict=True
    ):
        assert one == two if isinstance(one, int) else bits(one) == bits(two)


def test_bytes_of_something_else_are_refused() -> None:
    stepper = made()
    data = stepper.to_bytes(after(stepper, 2))
    for broken in (b"", data[:-1], data + b"0", b"x" + data[1:]):
        with pytest.raises(RecordError, match="no state of this controller"):
            stepper.from_bytes(broken)
    changed = bytearray(data)
    changed[100] ^= 1
    with pytest.raises(RecordError, match="damaged"):
        stepper.from_bytes(bytes(changed))
    slower = mt.deploy(make_controller("reallocating_initial"), 2e-3, engine="torch")
    with pytest.raises(RecordError, match="another controller, period"):
        slower.from_bytes(data)


def test_a_tree_is_packed_and_unpacked(compiled: mt.Stepper) -> None:
    state = after(compiled, 4)
    assert bits(compiled.packed(compiled.unpacked(state))[:-1]) == bits(state[:-1])


def test_float32_is_float64_within_its_rounding() -> None:
    double, single = made(), made(dtype=torch.float32)
    assert single.initial_state(*rows(0, torch.float32)).dtype == torch.float32
    state, small = after(double, 1), after(single, 1)
    for k in range(20):
        u, state = double(state, *rows(k))
        v, small = single(small, *rows(k, torch.float32))
    assert v.dtype == torch.float32
    assert float((u - v).abs().max() / u.abs().max()) < 1e-4


@pytest.mark.parametrize("engine", ["torch", "compiled"])
def test_constants_are_those_of_when_it_was_made(engine: str) -> None:
    stepper = mt.deploy(controller := make_controller("nn"), PERIOD, engine=engine)
    state = stepper.initial_state(*rows(0))
    first, _ = stepper(state, *rows(1))
    with torch.no_grad():
        controller.robust.base_gain.fill_(40.0)
    assert torch.equal(stepper(state, *rows(1))[0], first)
    second, _ = mt.deploy(controller, PERIOD, engine=engine)(state, *rows(1))
    assert not torch.equal(first, second)


def test_a_law_that_can_not_be_compiled_runs_in_torch() -> None:
    class Asking(mt.SoftAttention):
        def forward(self, comparison, active):  # type: ignore[no-untyped-def]
            weights = super().forward(comparison, active)
            return weights if bool((weights >= 0.0).all()) else -weights

    memory = mt.WorkingMemory(2, 6, Asking())
    stepper = mt.deploy(mt.MannController(2, 6, memory), PERIOD)
    assert stepper.engine == "eager" and stepper.engine_reason
    assert stepper.step(stepper.initial_state(*rows(0)), *rows(0)).flags == 0


def test_what_is_wrong_is_named(compiled: mt.Stepper) -> None:
    state = after(compiled, 1)
    reference, measurement = rows(0)
    with pytest.raises(ShapeError, match=r"reference has shape \(5,\), not \(6,\)"):
        compiled(state, reference[:5], measurement)
    with pytest.raises(DtypeError, match=r"measurement is torch.float32"):
        compiled(state, reference, measurement.float())
    with pytest.raises(ShapeError, match=r"state has shape"):
        compiled(state[1:], reference, measurement)
    with pytest.raises(KindError, match="adapt = 1"):
        compiled(state, reference, measurement, adapt=1)  # type: ignore[arg-type]
    with pytest.raises(KindError, match="measurement"):
        compiled(state, reference, "here")
