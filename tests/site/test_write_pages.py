"""docs/write: its pages run as printed, compiled, and show what happens."""

from __future__ import annotations

import re
from typing import Any

import pytest
import torch

import mann_torch as mt
from tests.pages import DOCS, executed, pieces_of, snippets_of

PAGES = (
    "write/attention.md",
    "write/controller.md",
    "write/key_rule.md",
    "write/law.md",
    "write/plant.md",
    "write/reference.md",
    "write/sensor.md",
)
#: How long the first part of a page may be, in lines of its classes: "a dozen lines".
SHORT = 15


def page(name: str) -> dict[str, Any]:
    return executed(f"write/{name}")


def test_there_is_a_page_for_every_part() -> None:
    assert {f"write/{path.name}" for path in (DOCS / "write").glob("*.md")} == set(PAGES)


@pytest.mark.parametrize("name", PAGES)
def test_every_rollout_is_compiled(name: str) -> None:
    runs = {k: v for k, v in executed(name).items() if isinstance(v, mt.Trajectory)}
    assert runs
    for run in runs.values():
        assert run.engine == "compiled", run.engine_reason
        assert not bool(run.status.any())


@pytest.mark.parametrize("name", PAGES)
def test_the_first_part_is_short_is_checked_and_one_is_refused(name: str) -> None:
    first, *others = pieces_of(name)
    classes = re.findall(r"^class .*?(?=^\S|\Z)", first.code, re.S | re.M)
    lines = [line for line in "".join(classes).splitlines() if line.strip()]
    assert len(lines) <= SHORT, len(lines)
    assert re.search(r"^check_\w+\(", first.code, re.M)
    wrong = [piece for piece in others if "except mt.InterfaceError" in piece.code]
    assert wrong and all("contract line" in (piece.shown or "") for piece in wrong)


def test_the_adaptive_gains_are_the_published_ones() -> None:
    names = page("controller.md")
    command, output = (x[-1, :, 0].tolist() for x in names["run"].states.controller)
    assert command == pytest.approx([1.55884883, 2.09404964], rel=1e-8)
    assert output == pytest.approx([0.45940876, -0.07769416], rel=1e-7)
    slopes = names["gamma"].grad
    assert bool(torch.isfinite(slopes).all() and (slopes != 0).all())


def test_the_controller_is_short_and_has_no_dummies() -> None:
    snippet = snippets_of("write/controller.md")[0]
    assert not {"NetworkState", "Features", "ControllerState"} & set(re.findall(r"\w+", snippet))


def test_the_flexible_arm_follows_with_its_links() -> None:
    names = page("plant.md")
    run = names["flexible"]
    assert [c.name for c in run.inputs] == ["torque_1", "torque_2"]
    assert run.plant.q.shape[-1] == 4 and run.output.shape[-1] == 2
    assert torch.equal(run.output, run.plant.q[..., :2])
    # What gravity stretches the springs by: some 30 N m over 2000 N m/rad.
    assert 1e-3 < float(names["stretch"]) < 0.05
    assert float(mt.srmse(run).max()) < 0.1


def test_a_payload_weighs_on_one_link_alone() -> None:
    names = page("plant.md")
    masses = names["payload"].at(torch.tensor([1.0, 3.0, 4.5], dtype=torch.float64))
    assert masses.tolist() == [[0.8, 2.3], [0.8, 3.8], [0.8, 2.3]]
    arm, loop = names["arm"], mt.ClosedLoop(names["arm"], mt.MannController(2, 10))
    scenario = mt.Scenario(mt.Sinusoid([1.0, 0.5]), arm.parameters_of(), 5.0)
    with torch.no_grad():
        free = mt.rollout(loop, scenario)
    carried = names["carried"]
    apart = (carried.output - free.output).abs().amax(dim=-1)
    assert float(apart[carried.t <= 2.0].max()) < 1e-12 < 1e-3 < float(apart.max())


def test_rain_lifts_the_tanks_level() -> None:
    names = page("plant.md")
    dry = mt.Scenario(mt.Sinusoid([0.5]), names["RainTank"]().parameters_of(), 10.0)
    loop = mt.ClosedLoop(names["RainTank"](), mt.LinearFeedback([[8.0]], [[8.5]]))
    with torch.no_grad():
        run = mt.rollout(loop, dry, mt.RungeKutta(5e-3))
    assert float((names["rained"].output - run.output)[1:].min()) > 0.0


def test_the_slope_by_a_reference_is_that_of_differences() -> None:
    names = page("reference.md")
    errors = []
    for step in (-1e-5, 1e-5):
        chirp = names["Chirp"]([1.0, 0.5], [0.3 + step, 0.2])
        scenario = mt.Scenario(chirp, mt.arm_parameters(), horizon=10.0)
        with torch.no_grad():
            errors.append(mt.srmse(mt.rollout(names["loop"], scenario)).sum())
    slope = float(errors[1] - errors[0]) / 2e-5
    assert float(names["chirp"].rate.grad[0]) == pytest.approx(slope, rel=1e-4)


def test_the_resolver_is_the_plain_sensor_without_ripple() -> None:
    names = page("sensor.md")
    seen = torch.randn(5, 4, dtype=torch.float64)
    plain = mt.Sensor(quantum=1e-4).read(seen)
    assert torch.equal(names["Resolver"](0.0, quantum=1e-4).read(seen), plain)
    error = names["errors"].sum(-1)
    assert bool((error[1:] > error[:-1]).all())


def test_commanded_and_applied_differ_where_the_actuator_is_at_its_limit() -> None:
    seen = page("sensor.md")["seen"]
    assert float(seen.input.max()) > 3.0 and float(seen.applied.max()) <= 3.4
    readings = seen.measurement[0] / 0.01
    assert torch.allclose(readings, readings.round(), rtol=0, atol=1e-9)


def test_a_compared_part_is_a_part() -> None:
    names = page("key_rule.md")
    rule = names["PartKeys"](2)
    context = torch.randn(3, 4, dtype=torch.float64)
    assert torch.equal(rule.fresh_keys(context), context[:, :2])
    assert names["keys"].shape[-2:] == (5, 1)
    # The arm starts at 0, and so do all keys; the one that is attended follows.
    moved = (names["keys"][-1] != 0).any(dim=-1)
    assert 1 <= int(moved.sum()) < 5
