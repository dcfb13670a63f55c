"""Filters that find the uncertainty without a derivative of the state."""

from __future__ import annotations

from typing import NamedTuple

import pytest
import torch
from torch import Tensor

import mann_torch as mt
from mann_torch import control
from mann_torch.errors import ConfigError, ShapeError
from mann_torch.plants import CHOWDHARY_JOHNSON, RowState, WingRock
from mann_torch.signals import Sinusoid
from tests.conftest import randn

MODEL, INPUT, LINE = [[0.0, 1.0], [-1.0, -1.0]], [[0.0], [1.0]], [[0.0, 1.0], [0.0, 0.0]]


def features(z: Tensor) -> Tensor:
    return WingRock.basis(z[..., :2])


def controller(labels: control.Labels | None, saturation: bool = False) -> control.Mrac:
    network = control.LinearNetwork(control.FunctionBasis(features, 3, 6), 1)
    limits = control.Hedging(MODEL, INPUT, 1.0) if saturation else None
    return control.Mrac.of_model(
        MODEL, INPUT, network, feedback=[[1.0, 1.0]], feedforward=[[1.0]],
        labels=labels, saturation=limits,
    )  # fmt: skip


@pytest.mark.parametrize("limited", [pytest.param(False, marks=pytest.mark.slow), True])
def test_the_label_is_exact_from_the_first_instant_on(limited: bool) -> None:
    """W*' phi_f = Delta_f, wherever the state starts; of a limited input, that which is applied."""
    labels = control.FilteredLabels(LINE, INPUT, 4.0)
    plant, made = WingRock(), controller(labels, limited)
    loop = mt.ClosedLoop(
        plant,
        made,
        actuator=mt.Actuator(1, limit=1.0) if limited else None,
        model=mt.LinearModel(MODEL, INPUT, [[1.0, 0.0]]),
    )
    start = RowState(torch.tensor([0.7, -0.5], dtype=torch.float64))
    scenario = mt.Scenario(Sinusoid([1.0], 2.0), plant.parameters_of(), 3.0, start=start)
    with torch.no_grad():
        run = mt.rollout(loop, scenario, mt.RungeKutta(2e-3), sample_dt=0.1)
    kept, x = run.states.controller.labels, run.states.plant.x
    pair = labels.pair(RowState(x), x, features(x), kept)
    sought = -torch.tensor(CHOWDHARY_JOHNSON, dtype=torch.float64).unsqueeze(-1)
    fitted = pair.regressor.mT @ sought
    assert float(pair.label.abs().max()) > 0.3
    torch.testing.assert_close(pair.label, fitted, rtol=0, atol=1e-9)


def test_of_two_inputs_each_has_its_own() -> None:
    """At rest of the filters: x' is known, so Delta is what B does not explain."""
    A, B = randn(3, 3), randn(3, 2, seed=1)
    labels = control.FilteredLabels(A, B, 2.0)
    x, x_f, u, delta, phi = (randn(n, seed=k) for k, n in enumerate((3, 3, 2, 2, 4)))
    # What the filters hold once x, u and Delta have stood still for long, but x_f, that lags.
    known = 2.0 * (x - x_f) - B @ delta
    kept = labels.initial_state(4, x, ())._replace(x=x_f, known=known, phi=phi)
    pair = labels.pair(RowState(x), x, phi, kept)
    torch.testing.assert_close(pair.label, -delta.unsqueeze(0), rtol=0, atol=1e-12)
    rates = labels.rates(x, u, phi, kept)
    torch.testing.assert_close(rates.known, 2.0 * (A @ x + B @ u - known), rtol=0, atol=1e-12)


def test_what_is_measured_is_the_label_itself() -> None:
    labels, wing = control.MeasuredLabels("moment"), WingRock(accelerometer=True)
    state = RowState(randn(5, 2))
    seen = wing.measure(state, wing.parameters_of())
    phi = WingRock.basis(state.x)
    pair = labels.pair(seen, state.x, phi, None)
    sought = -torch.tensor(CHOWDHARY_JOHNSON, dtype=torch.float64).unsqueeze(-1)
    torch.testing.assert_close(pair.label, pair.regressor.mT @ sought, rtol=0, atol=1e-14)


class Twice(NamedTuple):
    moment: Tensor
    x: Tensor


def test_a_field_that_is_not_there_is_named() -> None:
    made = controller(control.MeasuredLabels("moment"))
    reference = mt.ReferenceSample(
        randn(1), command=randn(1), state=randn(2)
    )  # of a model of two states
    with pytest.raises(ConfigError, match=r"'moment' must be the last field .* measured are x"):
        made.initial_state(reference, RowState(randn(2)), ())
    with pytest.raises(ConfigError, match="measured are moment, x"):
        made.initial_state(reference, Twice(randn(1), randn(2)), ())
    with pytest.raises(ShapeError, match="'moment' must have 1 numbers"):
        seen = WingRock(accelerometer=True).measure(RowState(randn(2)), WingRock().parameters_of())
        made.initial_state(reference, seen._replace(moment=randn(2)), ())
