"""What is not installed is named, with the line that installs it."""

from __future__ import annotations

import sys
from importlib import import_module

import pytest

import mann_torch as mt
from mann_torch.simulators import MujocoModel, arm_mjcf

SAID = r"^{} is not installed: pip install mann_torch\[simulators\]$"


def test_without_mujoco(monkeypatch: pytest.MonkeyPatch) -> None:
    text = arm_mjcf(mt.TwoLinkArm())  # text needs none
    monkeypatch.setitem(sys.modules, "mujoco", None)
    with pytest.raises(mt.ConfigError, match=SAID.format("mujoco")):
        MujocoModel(text, ["joint_1"])


@pytest.mark.parametrize("name", ["plant_env", "plant_vector_env"])
def test_without_gymnasium(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "gymnasium", None)
    monkeypatch.delitem(sys.modules, f"mann_torch.simulators.{name}", raising=False)
    with pytest.raises(mt.ConfigError, match=SAID.format("gymnasium")):
        import_module(f"mann_torch.simulators.{name}")


def test_other_names_are_refused() -> None:
    with pytest.raises(ImportError, match="Nothing"):
        from mann_torch.simulators import Nothing  # noqa: F401
