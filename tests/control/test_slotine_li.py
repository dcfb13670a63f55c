"""Slotine and Li's controller: what it refuses, and its terms."""

from __future__ import annotations

import pytest
import torch

import mann_torch as mt
from mann_torch.control import (
    AdaptiveLaw,
    BoundaryLayer,
    ConcurrentLearning,
    ConstantGain,
    IntegralAction,
    SlotineLi,
)
from mann_torch.errors import ConfigError, KindError, ShapeError
from mann_torch.plants import LinearPlant, SlotineLiArm, TwoLinkArm
from mann_torch.signals import Disturbance, Polynomial, Sinusoid

ARM = SlotineLiArm()
TRUE = ARM.parameters_of().a


def rolled(controller: SlotineLi, horizon: float, push: float = 0.0, **options: object) -> object:
    scenario = mt.Scenario(
        Sinusoid([0.4, 0.3], 2.0), ARM.parameters_of(), horizon,
        disturbance=Disturbance(input=Polynomial([[push, 0.0]])),
    )  # fmt: skip
    return mt.rollout(mt.ClosedLoop(ARM, controller), scenario, mt.RungeKutta(2e-3), **options)


def test_with_the_right_parameters_there_is_no_error_but_the_first() -> None:
    """r' M = -(C + K_D) r: r decays, and errors after it by Lambda."""
    controller = SlotineLi(ARM, AdaptiveLaw(ConstantGain(0.0)), 8.0, 40.0, start=TRUE)
    with torch.no_grad():
        run = rolled(controller, 4.0)
    assert float(run.error.abs().max()) > 1e-2
    assert float(run.error[-1].abs().max()) <= 1e-9


PLAIN = {"mechanics": ARM, "law": AdaptiveLaw(ConstantGain(0.0)), "start": TRUE}


def test_terms_of_nothing_change_nothing() -> None:
    ends = []
    for terms in ({}, {"robust": BoundaryLayer(0.0), "integral": IntegralAction(0.0)}):
        with torch.no_grad():
            run = rolled(SlotineLi(**PLAIN, **terms), 0.1, 5.0, engine="torch")
        ends.append(run.plant.q[-1])
    assert torch.equal(*ends)


def test_an_integral_takes_a_push_away() -> None:
    controller = SlotineLi(**PLAIN, integral=IntegralAction())
    controller.initialize(integral_gain=[[0.0], [60.0]])
    with torch.no_grad():
        run = rolled(controller, 20.0, 5.0)
    off, caught = run.error[-1].abs().amax(-1).tolist()
    assert off > 1e-2
    assert caught < 1e-3 * off, (off, caught)


def test_what_does_not_fit_is_named() -> None:
    with pytest.raises(ConfigError, match="TwoLinkArm has no regressor"):
        SlotineLi(TwoLinkArm())
    with pytest.raises(KindError, match=r"mechanics = .*Mechanics"):
        SlotineLi(LinearPlant([[-1.0]], [[1.0]], [[1.0]]))  # type: ignore[arg-type]
    with pytest.raises(ConfigError, match="needs pair of a drive"):
        SlotineLi(ARM, AdaptiveLaw(ConcurrentLearning(0.1)))
    with pytest.raises(ShapeError, match="give 4 numbers, or one"):
        SlotineLi(ARM, start=[1.0, 2.0])
    with pytest.raises(ShapeError, match="controller of 2"):
        SlotineLi(ARM).check_fit(1, 1)
