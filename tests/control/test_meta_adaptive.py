"""Tracking with features: the nominal model's part, and a memory's."""

from __future__ import annotations

import pytest
import torch

import mann_torch as mt
from mann_torch.control import (
    AdaptiveLaw,
    ComputedTorque,
    ConstantGain,
    Identity,
    Layers,
    LinearNetwork,
    Measured,
    MetaAdaptive,
)
from mann_torch.errors import ConfigError, ShapeError
from mann_torch.functional import row_times
from mann_torch.plants import TwoLinkArm
from mann_torch.types import Measurement, ReferenceSample
from tests.conftest import generator

ARM = TwoLinkArm()
NOMINAL = {"mechanics": ARM, "parameters": ARM.parameters_of()}


def network() -> LinearNetwork:
    return LinearNetwork(Layers.random(4, 5), 2, AdaptiveLaw(ConstantGain(2.0)), start=0.7)


def seen() -> tuple[ReferenceSample, Measurement]:
    g = generator(1)
    rows = [torch.randn(8, 2, generator=g, dtype=torch.float64) for _ in range(5)]
    return ReferenceSample(*rows[:3]), Measurement(*rows[3:])


def test_a_memory_adds_what_it_reads_through_the_weights() -> None:
    memory = mt.WorkingMemory(3, 5, mt.HardAttention())
    plain, made = MetaAdaptive(network()), MetaAdaptive(network(), memory=memory)
    state, mode = made.initial_state(*seen(), (8,))
    found, bare = made(*seen(), state, mode), plain(*seen(), *plain.initial_state(*seen(), (8,)))
    assert float(found.signals.read.abs().max()) > 0.1
    added = row_times(found.signals.read, state.adaptive.network.W)
    torch.testing.assert_close(found.input - bare.input, added, rtol=1e-12, atol=1e-12)
    assert made.switches and not plain.switches


def test_with_nothing_to_learn_it_is_computed_torque_and_more_feedback() -> None:
    """M (dds + Lambda de) + C v + N + K r, where computed torque has K_d = Lambda and C qd."""
    still = LinearNetwork(Identity(4), 2, AdaptiveLaw(ConstantGain(0.0)))
    at, lam = seen(), 3.0
    meta = MetaAdaptive(still, **NOMINAL, error_gain=lam, feedback=7.0)
    u = meta(*at, *meta.initial_state(*at, (8,))).input
    other = ComputedTorque(ARM, ARM.parameters_of(), 1e-9, lam)
    base = other(*at, None, None).input
    s, ds, _ = at[0].upto(2)
    error, error_rate = s - at[1].q, ds - at[1].qd
    r = error_rate + lam * error
    turned = ARM.coriolis(at[1].q, at[1].qd, ARM.coefficients(ARM.parameters_of()))
    known = base + 7.0 * r + (turned @ r.unsqueeze(-1))[..., 0]
    torch.testing.assert_close(u, known, rtol=1e-6, atol=1e-6)


def test_the_drive_gain_scales_each_output_s_adaptation() -> None:
    rates = []
    for gain in (1.0, [1.0, 4.0]):
        controller = MetaAdaptive(network(), drive_gain=gain)
        rates.append(controller(*seen(), *controller.initial_state(*seen(), (8,))).d_state)
    one, two = (found.adaptive.network.W for found in rates)
    torch.testing.assert_close(two, one * torch.tensor([1.0, 4.0]).double(), rtol=1e-14, atol=0)


def test_what_does_not_fit_is_named() -> None:
    with pytest.raises(ConfigError, match="or neither"):
        MetaAdaptive(network(), ARM)
    with pytest.raises(ShapeError, match="2 coordinates and a network of 3 outputs"):
        MetaAdaptive(LinearNetwork(Identity(6), 3), **NOMINAL)
    with pytest.raises(ShapeError, match="4 inputs is fed 5"):
        MetaAdaptive(network(), inputs=Measured(5))
