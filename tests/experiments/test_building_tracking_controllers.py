"""Tracking controllers and L1 from their settings, with the plant's equations, laws and memory."""

from __future__ import annotations

import re
from typing import Any

import pytest
import torch

from experiments.building.build import build
from experiments.building.ensembles import composed
from mann_torch import control
from mann_torch.errors import ConfigError
from mann_torch.memory import HardAttention

LINEAR = (
    "plant=linear", "plant.A=[[0.0,1.0],[3.0,-5.9]]", "plant.B=[[0.0],[1.0]]",
    "plant.C=[[1.0,0.0]]", "plant.measured=state", "scenario=plain",
)  # fmt: skip
FEATURES = "network.basis.path=experiments/problems/data/pfar_features.npz"


def made(*overrides: str) -> Any:
    return build(composed(overrides)).loop.controller


def test_pid_and_computed_torque() -> None:
    pid = made("plant=two_link_arm", "scenario=plain", "controller=pid", "controller.limit=80.0")
    assert isinstance(pid, control.Pid) and pid.n_outputs == 2 and pid.limits
    torque = made(
        "plant=two_link_arm", "scenario=plain", "controller=computed_torque",
        "controller.robust={sliding_gain: 2.0, layer: 0.1}",
        "controller.nominal={masses: [1.0, 1.0]}",
    )  # fmt: skip
    assert isinstance(torque, control.ComputedTorque)
    assert float(torque.constant("sliding_gain")) == 2.0
    own = made("plant=two_link_arm", "scenario=plain", "controller=computed_torque").nominal
    at = torch.zeros(2, dtype=torch.float64)
    assert not torch.equal(torque.nominal.mass(at), own.mass(at))


def test_slotine_li_with_its_law() -> None:
    found = made(
        "plant=slotine_li_arm", "scenario=plain", "controller=slotine_li", "law=sigma",
        "controller.start=[3.0,1.0,1.0,0.5]",
    )  # fmt: skip
    assert isinstance(found, control.SlotineLi) and found.law.decays
    assert found.start.tolist() == [3.0, 1.0, 1.0, 0.5]
    with pytest.raises(ConfigError, match="TwoLinkArm has no regressor"):
        made("plant=two_link_arm", "scenario=plain", "controller=slotine_li")


@pytest.mark.checkout
def test_meta_adaptive_with_layers_of_a_file_and_a_memory() -> None:
    found = made(
        "plant=planar_quadrotor", "scenario=plain", "controller=meta_adaptive", "network=layers",
        FEATURES, "law=gradient", "+controller.attention=hard",
    )  # fmt: skip
    assert isinstance(found, control.MetaAdaptive) and found.nominal is not None
    assert found.network.n_hidden == 32
    assert isinstance(found.memory.attention, HardAttention)


def test_l1_by_a_law_or_by_a_period() -> None:
    one = made(*LINEAR, "controller=l1", "law=box_projection")
    assert isinstance(one, control.L1Adaptive) and one.periods == ()
    assert made(*LINEAR, "controller=l1", "controller.period=0.01").periods == (0.01,)
    with pytest.raises(ConfigError, match="not both"):
        made(*LINEAR, "controller=l1", "law=gradient", "controller.period=0.01")


def test_readouts_of_controllers_that_can_judge_them() -> None:
    arm = ("plant=two_link_arm", "scenario=plain", "controller=nn")
    found = made(*arm, "controller.readouts={n_slots: 3, recall_time: 0.1}").approximator.readouts
    assert found.n_slots == 3 and float(found.recall_time) == 0.1
    given = ("problem=wing_rock", "plant.accelerometer=true", "model.start=null")
    labels = "controller.labels={name:measured,field:moment}"
    found = made(*given, labels, "controller.readouts={n_slots: 2}").approximator.readouts
    assert found.n_slots == 2
    refused = {
        "nothing to tell: give it labels": (
            "controller=mrac", "plant=double_integrator", "model=second_order", "scenario=plain",
            "network=identity", "controller.readouts={n_slots: 2}",
        ),
        "controller.readouts.slots": (*arm, "controller.readouts={slots: 2}"),
        "controller.readouts.sharpness = 0.0": (*arm, "controller.readouts={sharpness: 0.0}"),
        "controller.readouts.n_slots = 5000: at most": (
            *arm, "controller.readouts={n_slots: 5000}",
        ),
        "controller.readouts = 5": (*arm, "controller.readouts=5"),
        "unknown setting 'controller.readouts'": (
            "plant=two_link_arm", "scenario=plain", "controller=pid",
            "+controller.readouts={n_slots: 2}",
        ),
    }  # fmt: skip
    for told, overrides in refused.items():
        with pytest.raises(ConfigError, match=re.escape(told)):
            made(*overrides)
