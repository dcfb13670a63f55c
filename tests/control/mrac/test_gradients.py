"""Gradients to every constant of MRAC and its parts, on both engines."""

from __future__ import annotations

import pytest
import torch
from torch import Tensor

import mann_torch as mt
from mann_torch import control
from mann_torch.plants import LinearPlant
from mann_torch.signals import Sinusoid

MODEL, INPUT = [[0.0, 1.0], [-4.0, -3.0]], [[0.0], [1.0]]


def of_state() -> tuple[control.Controller, mt.LinearModel]:
    """With a part of each kind, the input at its limit for a while."""
    law = control.AdaptiveLaw(
        control.ConstantGain(20.0),
        control.SigmaModification(0.1),
        control.ConcurrentLearning(0.5, size=3, period=0.1),
        control.Projection(0.1, 0.5),
    )
    made = control.Mrac.of_model(
        MODEL,
        INPUT,
        control.LinearNetwork(control.Identity(3), 1, law, start=0.1),
        feedback=[[4.0, 3.0]],
        feedforward=[[4.0]],
        error_feedback=[[0.5, 0.5]],
        robust=control.BoundaryLayer(0.5, 0.2),
        integral=control.IntegralAction(0.5),
        saturation=control.MuModification(MODEL, INPUT, 1.5, 2.0, 0.3, start=0.5),
        labels=control.FilteredLabels([[0.0, 1.0], [0.0, 0.0]], INPUT, 5.0),
    )
    return made, mt.LinearModel(MODEL, [[0.0], [4.0]], [[1.0, 0.0]])


def of_output() -> tuple[control.Controller, mt.LinearModel]:
    made = control.OutputMrac([2.0, 3.0], robust=control.BoundaryLayer(0.5, 0.2))
    return made, mt.LinearModel([[-3.0]], [[3.0]])


@pytest.mark.parametrize("make", [pytest.param(of_state, marks=pytest.mark.slow), of_output])
def test_engines_have_the_same(make: object) -> None:
    controller, model = make()  # type: ignore[operator]
    measured = "state" if make is of_state else "output"
    C = [[1.0, 0.0]] if make is of_state else [[1.0, 1.0]]
    plant = LinearPlant([[0.0, 1.0], [1.0, 0.5]], INPUT, C, measured)
    loop = mt.ClosedLoop(plant, controller, model=model, actuator=mt.Actuator(1, limit=1.5))
    scenario = mt.Scenario(Sinusoid([1.5], 4.0, offset=0.5), plant.parameters_of(), 0.5)
    names = sorted(controller.constants())

    def gradients(engine: str) -> list[Tensor]:
        free = controller.tune(*names)
        run = mt.rollout(loop, scenario, mt.RungeKutta(1e-2), sample_dt=0.1, engine=engine)
        kept = run.states.controller.adaptive.network.W.square().mean()
        return list(torch.autograd.grad(run.squared_error.mean() + kept, free))

    pairs = zip(names, gradients("torch"), gradients("compiled"), strict=True)
    for name, expected, found in pairs:
        assert bool(expected.any()), name
        assert float((found - expected).norm() / expected.norm()) <= 1e-10, name
