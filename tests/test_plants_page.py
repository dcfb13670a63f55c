"""docs/plants.md does what it says: its code runs as printed, compiled, and its figures hold."""

import re
from typing import Any

import pytest
import torch

import mann_torch as mt
from tests.pages import executed, snippets_of


@pytest.fixture(scope="module")
def page() -> dict[str, Any]:
    return executed("plants.md")


def test_every_rollout_is_compiled(page: dict[str, Any]) -> None:
    for name in ("run", "basis", "flexible", "carried", "watered"):
        assert page[name].engine == "compiled", page[name].engine_reason
        assert not bool(page[name].status.any())


def test_the_adaptive_gains_are_the_published_ones(page: dict[str, Any]) -> None:
    command, output = (x[-1, :, 0].tolist() for x in page["run"].states.controller)
    assert command == pytest.approx([1.55884883, 2.09404964], rel=1e-8)
    assert output == pytest.approx([0.45940876, -0.07769416], rel=1e-7)
    assert bool(torch.isfinite(page["gamma"].grad).all() and (page["gamma"].grad != 0).all())


def test_the_controller_is_short_and_has_no_dummies() -> None:
    (snippet,) = (s for s in snippets_of("plants.md") if "class LinearMrac" in s)
    lines = [line for line in snippet.splitlines() if line.strip()]
    assert len(lines) < 25
    assert not {"NetworkState", "Features", "ControllerState"} & set(re.findall(r"\w+", snippet))


def test_the_flexible_arm_follows_with_its_links(page: dict[str, Any]) -> None:
    run = page["flexible"]
    assert [c.name for c in run.inputs] == ["torque_1", "torque_2"]
    assert run.plant.q.shape[-1] == 4 and run.output.shape[-1] == 2
    assert torch.equal(run.output, run.plant.q[..., :2])
    # What gravity stretches the springs by: some 30 N m over 2000 N m/rad.
    assert 1e-3 < float(page["stretch"]) < 0.05
    assert float(mt.srmse(run).max()) < 0.1


def test_a_payload_weighs_on_one_link_alone(page: dict[str, Any]) -> None:
    masses = page["payload"].at(torch.tensor([1.0, 3.0, 4.5], dtype=torch.float64))
    assert masses.tolist() == [[0.8, 2.3], [0.8, 3.8], [0.8, 2.3]]
    arm, loop = page["arm"], mt.ClosedLoop(page["arm"], mt.MannController(2, 10))
    scenario = mt.Scenario(mt.Sinusoid([1.0, 0.5]), arm.parameters_of(), 5.0)
    with torch.no_grad():
        free = mt.rollout(loop, scenario)
    carried = page["carried"]
    apart = (carried.output - free.output).abs().amax(dim=-1)
    assert float(apart[carried.t <= 2.0].max()) < 1e-12 < 1e-3 < float(apart.max())


def test_commanded_and_applied_differ_where_the_actuator_is_at_its_limit(
    page: dict[str, Any],
) -> None:
    seen = page["seen"]
    assert float(seen.input.max()) > 3.0 and float(seen.applied.max()) <= 3.0
    assert float(seen.applied.min()) >= 0.0
    readings = seen.measurement.level / 0.01
    assert torch.allclose(readings, readings.round(), rtol=0, atol=1e-9)
