"""Plants, references, controllers and parts of the loop through the commands."""

import csv
import importlib
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

import mann_torch as mt
from mann_torch.plants import PLANTS, Pendulum
from mann_torch.signals import Steps
from tests.experiments.command import exit_code

QUIET = ("output.figures=false", "output.tensorboard=false")
PENDULUM = ("plant=pendulum", "scenario=plain")
#: A controller for each plant that the default one does not fit.
FEEDBACK = {
    "wing_rock": "controller.feedback=[[4,4]]",
    "linear": "controller.feedback=[[4]]",
    "regression": "controller.feedback=[[0,0,-1,0]] controller.feedforward=null",
    "rohrs": "controller.feedback=[[1]]",
    "cart_pole": "controller.feedback=[[-1,-30,-2,-8]] controller.feedforward=null",
    "planar_quadrotor": "controller.feedback=[[0,4,0,0,4,0],[0,0,9,0,0,6],[4,0,0,4,0,0]] "
    "controller.feedforward=null controller.offset=[9.81,0,0]",
}


def run(monkeypatch: pytest.MonkeyPatch, command: str, *arguments: str) -> int:
    main = importlib.import_module(f"experiments.{command}").main
    return exit_code(monkeypatch, main, *arguments)


def record(folder: Path) -> Any:
    return json.loads((folder / "metrics.json").read_text())


@pytest.mark.slow
def test_a_sweep_over_plants_names_their_outputs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    names = ("pendulum", "wing_rock", "double_integrator")
    assert (
        run(
            *(monkeypatch, "simulate", "-m", f"plant={','.join(names)}", "scenario=plain", *QUIET),
            *("controller=linear_feedback", "horizon=0.3", "run_dir=sweep"),
        )
        == 0
    )
    outputs = {"pendulum": ("q_1", "rad"), "wing_rock": ("roll", "rad")}
    outputs["double_integrator"] = ("q_1", "m")
    for number, name in enumerate(names):
        told = record(tmp_path / "sweep" / str(number))
        assert told["engine"] == "compiled" and told["status"] == ["ok"]
        (output,) = told["outputs"]
        assert (output["name"], output["unit"]) == outputs[name] and told["plant"] == name
    rows = list(csv.DictReader((tmp_path / "sweep" / "sweep.csv").read_text().splitlines()))
    assert {row["plant"] for row in rows} == set(names)


@pytest.mark.slow
@pytest.mark.parametrize("name", PLANTS)
def test_every_plant_runs_compiled_with_pictures(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    how = ["controller=linear_feedback", *FEEDBACK[name].split()] if name in FEEDBACK else []
    arguments = [f"plant={name}", "scenario=plain", "horizon=0.5", *how, "run_dir=run"]
    assert run(monkeypatch, "simulate", *arguments) == 0
    told = record(tmp_path / "run")
    assert told["engine"] == "compiled" and told["status"] == ["ok"]
    assert (tmp_path / "run" / "outputs.png").exists()


def test_all_parts_at_once_are_the_loop_that_python_builds(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    assert (
        run(
            *(monkeypatch, "simulate", *PENDULUM, *QUIET, "horizon=1", "run_dir=run"),
            *("controller=linear_feedback", "controller.feedback=[[30,6]]"),
            *("controller.feedforward=[[30]]", "constants.offset=[1.5]", "draws=2"),
            *("reference=steps", "reference.times=[0.1]", "reference.values=[[0],[0.4]]"),
            *("model=second_order", "model.frequency=6", "plant.length=0.8", "plant.viscous=0.1"),
            *("actuator=lagged", "actuator.limit=9", "clock.period=0.01", "sensor.delay=0.02"),
            *("sensor.quantum=1e-3", "sensor.noise={std:[1e-3,1e-2],rate:200,seed:7}"),
            *("disturbance=input", "scenario.start.q=[0.05]"),
            "scenario.schedule.mass=[{at:0.5,add:0.3}]",
        )
        == 0
    )
    loop = mt.ClosedLoop(
        Pendulum(),
        mt.LinearFeedback([[30.0, 6.0]], [[30.0]], [1.5]),
        mt.Actuator(1, limit=9.0, lag=0.02),
        mt.Sensor(1e-3, 0.02),
        mt.Clock(0.01),
        mt.SecondOrderModel(1, 6.0),
    )
    scenario = mt.Scenario(
        Steps([0.1], [[0.0], [0.4]]),
        Pendulum().parameters_of(length=[0.8], viscous=[0.1]),
        1.0,
        {"mass": mt.PiecewiseConstant([0.5], [[1.0], [1.3]])},
        loop.plant.rest()._replace(q=torch.tensor([0.05], dtype=torch.float64)),
        mt.MeasurementNoise([1e-3, 1e-2], torch.tensor([7, 8]), 200.0),
        mt.Disturbance(mt.Sinusoid([0.1], 3.0)),
    )
    with torch.no_grad():
        expected = mt.srmse(mt.rollout(loop, scenario, mt.Implicit(4e-3)))
    assert record(tmp_path / "run")["srmse"] == expected.tolist()
    assert expected[0] != expected[1] and bool((expected < 0.1).all())
    with np.load(tmp_path / "run" / "trajectory.npz") as arrays:
        assert arrays["mass"].reshape(len(arrays["t"]), -1)[[0, -1], 0].tolist() == [1.0, 1.3]


@pytest.mark.slow
def test_the_papers_controller_has_any_network_under_any_law(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    short = (*PENDULUM, *QUIET, "horizon=2", "controller=nn")
    frozen = ("network=radial_basis", "law=gradient", "law.constant.adaptation_rate=0")
    found = {}
    for name, how in {"paper": (), "moves": frozen[:2], "frozen": frozen}.items():
        assert run(monkeypatch, "simulate", *short, *how, f"run_dir={name}") == 0
        found[name] = record(tmp_path / name)["srmse"][0][0]
    assert found["moves"] < 0.95 * found["frozen"] and found["moves"] != found["paper"]


@pytest.mark.slow
def test_tuning_another_plant(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    assert (
        run(
            *(monkeypatch, "tune", "plant=pendulum", "controller=nn", "names=[error_gain,rate_W]"),
            *("train.scenarios=[plain]", "held_out.scenarios=[plain]", "train.draws=[0,1]"),
            *("held_out.draws=[5,6]", "schedule.iterations=2", "horizon=1", "gradient.pairs=4"),
            *("gradient.control=[]", "effort_after=0.2", "grid=null", *QUIET, "run_dir=run"),
        )
        == 0
    )
    told = record(tmp_path / "run")
    assert set(told["constants"]) == {"error_gain", "rate_W"} and len(told["history"]) == 2
    assert np.shape(told["constants"]["error_gain"]) == (1, 1)
    assert "| plain | tuned |" in (tmp_path / "run" / "report.md").read_text()


@pytest.mark.slow
def test_gradients_of_another_plant_under_another_controller(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    assert (
        run(
            *(monkeypatch, "gradient_report", "plant=wing_rock", "scenario=plain", "draws=2"),
            *("controller=linear_feedback", "names=[feedback,lag]", "control=[]", "steps=[0.1]"),
            "actuator=lagged",
            *("temperatures=[]", "horizons=[0.2]", "horizon=0.5", "pairs=2", *QUIET, "run_dir=run"),
        )
        == 0
    )
    with (tmp_path / "run" / "elasticities.csv").open() as file:
        rows = list(csv.DictReader(file))
    found = {(row["constant"], row["mode"]): float(row["elasticity"]) for row in rows}
    for name in ("feedback", "lag"):  # of the controller, and of another part of the loop
        assert found[name, "plain"] == pytest.approx(found[name, "fd 10 %"], rel=0.02)
        assert found[name, "plain"] != 0.0


def test_an_ensemble_of_another_plant_tells_its_parameters(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    spread = ("spread.masses=null", "spread.mass=0.3", "spread.length=0.1")
    arguments = (*PENDULUM, *spread, "controller=linear_feedback", "horizon=0.3", *QUIET)
    sizes = ("rollouts=5", "chunk=3", "workers=1", "run_dir=run")
    assert run(monkeypatch, "ensemble", *arguments, *sizes) == 0
    rows = list(csv.DictReader((tmp_path / "run" / "rollouts.csv").read_text().splitlines()))
    assert len({row["mass_1"] for row in rows}) == len({row["length_1"] for row in rows}) == 5
    own = (f"plant.mass=[{rows[4]['mass_1']}]", f"plant.length=[{rows[4]['length_1']}]")
    shared = (*PENDULUM, "controller=linear_feedback", "horizon=0.3", *QUIET)
    assert run(monkeypatch, "simulate", *shared, *own, "run_dir=alone") == 0
    assert record(tmp_path / "alone")["srmse"] == [[float(rows[4]["srmse_q_1"])]]
