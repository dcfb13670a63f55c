"""Rohrs' plant: its closed forms."""

from __future__ import annotations

import cmath
import math

import numpy as np
import torch

from mann_torch.plants import RohrsPlant
from tests.plants.test_linear import response


def test_phase_is_180_degrees_at_the_root_of_259() -> None:
    plant = RohrsPlant()
    edge = response(plant, math.sqrt(259.0))
    assert abs(edge.imag) <= 1e-14 and edge.real < 0
    # 1 / |G| there is the gain at which the loop oscillates.
    assert math.isclose(-1.0 / edge.real, 7800 / 458, rel_tol=1e-12)
    below, above = (cmath.phase(response(plant, w)) for w in (16.0, 16.2))
    assert below < 0 < above


def test_frequency_response_is_slow_pole_times_fast_poles() -> None:
    plant, slow = RohrsPlant(), RohrsPlant(fast_poles=False)
    for w in np.logspace(-2, 3, 51):
        s = 1j * w
        fast = 229 / (s**2 + 30 * s + 229)
        assert abs(response(plant, w) - 2 / (s + 1) * fast) <= 1e-10 * abs(2 / (s + 1) * fast)
        assert abs(response(slow, w) - 2 / (s + 1)) <= 1e-12


def test_output_feedback_is_stable_below_the_closed_forms_gain_alone() -> None:
    plant = RohrsPlant()
    A, B, C = plant.coefficients(plant.parameters_of())
    worst = [
        float(torch.linalg.eigvals(A - k * B @ C).real.max())
        for k in (0.999 * 7800 / 458, 1.001 * 7800 / 458)
    ]
    assert worst[0] < 0 < worst[1]
