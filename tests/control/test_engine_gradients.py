"""Gradients to all constants of tracking controllers and of L1: the engines agree."""

from __future__ import annotations

from collections.abc import Callable

import pytest
import torch

import mann_torch as mt
from mann_torch import control
from mann_torch.plants import DoubleIntegrator, LinearPlant, Plant, SlotineLiArm
from mann_torch.signals import Sinusoid

ARM = SlotineLiArm()
MODEL, INPUT = [[0.0, 1.0], [-1.0, -1.4]], [[0.0], [1.0]]
UNCERTAIN = LinearPlant([[0.0, 1.0], [3.0, -5.9]], INPUT, [[1.0, 0.0]], "state")
LAW = control.AdaptiveLaw(control.ConstantGain(0.5), control.SigmaModification(0.1))


def extras() -> dict[str, object]:
    return {"robust": control.BoundaryLayer(2.0, 0.3), "integral": control.IntegralAction(3.0)}


MADE: dict[str, tuple[Plant, Callable[[], control.Controller]]] = {
    "pid": (DoubleIntegrator(), lambda: control.Pid(1, 6.0, 2.0, 4.0, limit=0.4)),
    "pid, filtered": (
        LinearPlant([[-1.0]], [[1.0]], [[1.0]]),
        lambda: control.Pid(1, 6.0, 2.0, 1.0, filter_rate=9.0),
    ),
    "computed_torque": (
        ARM,
        lambda: control.ComputedTorque(ARM, ARM.parameters_of(a=[3.0, 1.0, 0.8, 0.5]), **extras()),
    ),
    "slotine_li": (ARM, lambda: control.SlotineLi(ARM, LAW, 8.0, 40.0, **extras())),
    "meta_adaptive": (
        ARM,
        lambda: control.MetaAdaptive(
            control.LinearNetwork(control.Layers.random(4, 3), 2, LAW, start=0.3),
            ARM, ARM.parameters_of(), mt.WorkingMemory(2, 3, mt.HardAttention()), **extras(),
        ),
    ),
    "l1": (
        UNCERTAIN,
        lambda: control.L1Adaptive(
            MODEL, INPUT,
            control.AdaptiveLaw(control.ConstantGain(1e3), control.BoxProjection(0.2, 0.3)),
        ),
    ),
    "l1, piecewise constant": (
        UNCERTAIN, lambda: control.L1Adaptive(MODEL, INPUT, period=0.02)
    ),
}  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize("name", MADE)
def test_gradients_of_both_engines_agree(name: str) -> None:
    plant, make = MADE[name]
    found = []
    for engine in ("torch", "compiled"):
        controller = make()
        names = [n for n in controller.constants() if n != "shift_threshold"]
        freed = controller.tune(*names)
        scenario = mt.Scenario(
            Sinusoid([0.5] * len(plant.outputs), 2.0, 0.3), plant.parameters_of(), 0.1
        )
        loop = mt.ClosedLoop(plant, controller)
        run = mt.rollout(loop, scenario, mt.RungeKutta(2e-3), engine=engine)
        run.squared_error[-1].sum().backward()
        found.append([torch.zeros_like(p) if p.grad is None else p.grad for p in freed])
    size = max(float(g.abs().max()) for g in found[0])
    assert size > 0.0
    for name_, one, other in zip(names, *found, strict=True):
        torch.testing.assert_close(one, other, rtol=1e-10, atol=1e-12 * size, msg=name_)
