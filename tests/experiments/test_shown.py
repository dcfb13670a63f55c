"""What is shown of any loop: arrays, pictures, tables and curves by the names a plant gives."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

import mann_torch as mt
from experiments.building.ensembles import composed
from experiments.records.arrays import signal_arrays
from experiments.records.recording import channels_of, log_run, metrics_of, units_of
from experiments.runs.figures import inputs, of_draws, outputs, symbol, traces
from experiments.simulate import run_figures, summary
from experiments.sweeps.measures import measured
from mann_torch.control import LinearFeedback
from mann_torch.parts import Actuator, LinearModel, Sensor
from mann_torch.plants import FlexibleJointArm, PlanarQuadrotor, Plant
from mann_torch.signals import Disturbance, Polynomial, Sinusoid
from tests.experiments.command import logged
from tests.experiments.other_loops import Adapting, Levelling, short, tank


def arrays_of(loop: mt.ClosedLoop, scenario: mt.Scenario) -> dict[str, np.ndarray]:
    with torch.no_grad():
        return signal_arrays(loop, scenario, short(loop, scenario))


def fed_back(plant: Plant, width: int) -> tuple[mt.ClosedLoop, mt.Scenario]:
    """A plant under a weak feedback of all `width` numbers that are measured."""
    m, p = len(plant.inputs), len(plant.outputs)
    gains = 0.1 * torch.ones(m, width, dtype=torch.float64)
    parameters = plant.parameters_of()
    reference = Sinusoid([1.0] * p, 0.7, 0.2)
    return mt.ClosedLoop(plant, LinearFeedback(gains)), mt.Scenario(reference, parameters, 0.3)


def test_a_plants_own_fields_do_not_hide_the_loops() -> None:
    arrays = arrays_of(*tank(Levelling()))
    t = arrays["t"]
    np.testing.assert_allclose(t, np.linspace(0.0, 0.5, 11), atol=1e-12)
    assert arrays["outputs"].tolist() == [["level", "m"]]
    assert arrays["inputs"].tolist() == [["inflow", "m^3/s"]]
    assert arrays["states"].tolist() == ["state.error", "state.t"]
    assert arrays["parameters"].tolist() == [["area", "m^2"]]
    np.testing.assert_array_equal(arrays["state.error"], arrays["output"])
    np.testing.assert_allclose(arrays["reference"][:, 1, 0], 0.5 + np.sin(0.7 * t), rtol=1e-14)
    np.testing.assert_array_equal(arrays["error"], arrays["reference"] - arrays["output"])
    np.testing.assert_allclose(arrays["input"], 9.0 * arrays["error"], rtol=1e-14)
    # One schedule for all draws: every array but t and the texts has its draws.
    np.testing.assert_array_equal(arrays["area"][:, 0, 0], np.where(t < 0.2 - 1e-9, 1.0, 2.0))
    shapes = {a.shape for name, a in arrays.items() if name != "t" and a.dtype.kind != "U"}
    assert shapes == {(11, 2, 1)}


def test_a_controller_without_signals_state_or_memory_is_drawn_without_them() -> None:
    arrays = arrays_of(*tank(Levelling()))
    assert not len(arrays["adaptive"]) and "applied" not in arrays
    drawn = run_figures("title", "levelling", arrays, 1)
    assert set(drawn) == {"outputs", "inputs", "states"}
    top, bottom = drawn["outputs"].axes
    assert top.get_ylabel() == "level [m]" and bottom.get_ylabel() == "$e_{1}$ [mm]"
    # The area's jump is marked; the level is an output, the temperature is shown.
    assert any(line.get_xdata()[0] == pytest.approx(0.2) for line in top.lines[2:])
    (state,) = drawn["states"].axes
    assert state.get_ylabel() == "state.t"


def test_signals_and_states_of_ones_own_go_by_name() -> None:
    arrays = arrays_of(*tank(Adapting()))
    assert arrays["adaptive"].tolist() == ["k", "rate", "controller.k"]
    np.testing.assert_array_equal(arrays["k"][..., 0], arrays["controller.k"][..., 0])
    assert (arrays["rate"] == 3.0).all() and arrays["rate"].shape == (11, 2, 1)
    assert not any(array.size == 11 * 2 * 200 for array in arrays.values())
    drawn = run_figures("title", "adapting", arrays, 0)
    assert [ax.get_ylabel() for ax in drawn["controller"].axes] == ["$k$", "rate", "controller.k"]


@pytest.mark.parametrize("what", ["limit", "disturbance", "both"])
def test_what_is_applied_is_kept_and_drawn_where_it_differs(what: str) -> None:
    limited = {} if what == "disturbance" else {"actuator": Actuator(1, limit=4.2)}
    loop, scenario = tank(Levelling(), **limited)
    pushed = 0.0 if what == "limit" else 0.25
    if pushed:
        push = Disturbance(input=Polynomial([[pushed]]))
        scenario = dataclasses.replace(scenario, disturbance=push)
    arrays = arrays_of(loop, scenario)
    inside = np.clip(arrays["input"], -4.2, 4.2) if limited else arrays["input"]
    np.testing.assert_allclose(arrays["applied"], inside + pushed, rtol=1e-14)
    assert (arrays["input"] > 4.2).any() and (arrays["input"] < 4.2).any()
    run = of_draws(arrays, 0)
    (ax,) = inputs({"a": run}, "").axes
    assert ax.get_ylabel() == "inflow [m^3/s]"
    assert [line.get_label() for line in ax.lines[:2]] == ["a", "a: applied"]
    np.testing.assert_array_equal(ax.lines[1].get_ydata(), run["applied"][:, 0])


def test_an_actuator_that_changes_nothing_is_no_second_line() -> None:
    arrays = arrays_of(*tank(Levelling(), actuator=Actuator(1, limit=1e3)))
    np.testing.assert_array_equal(arrays["applied"], arrays["input"])
    (ax,) = inputs({"a": of_draws(arrays, 0)}, "").axes
    assert "a: applied" not in [line.get_label() for line in ax.lines]


def test_what_a_sensor_gives_is_kept_beside_what_is() -> None:
    arrays = arrays_of(*tank(Levelling(), sensor=Sensor(quantum=0.125, period=0.05)))
    seen = arrays["measurement.error"]
    np.testing.assert_array_equal(seen, np.round(seen / 0.125) * 0.125)
    assert np.abs(seen - arrays["output"]).max() > 1e-3


def test_three_outputs_have_a_panel_a_column_and_a_curve_each(tmp_path: Path) -> None:
    loop, scenario = fed_back(PlanarQuadrotor(), 6)
    trajectory = short(loop, scenario)
    arrays, metrics = arrays_of(loop, scenario), metrics_of(trajectory)
    run = {"quad": of_draws(arrays, 0)}
    labels = [ax.get_ylabel() for ax in outputs(run, "").axes]
    assert labels[:3] == ["$x$ [m]", "$y$ [m]", "pitch [rad]"]
    assert labels[3:] == ["$e_{1}$ [mm]", "$e_{2}$ [mm]", "$e_{3}$ [mrad]"]
    names = ["thrust [m/s^2]", "moment [rad/s^2]", "side_thrust [m/s^2]"]
    assert [ax.get_ylabel() for ax in inputs(run, "").axes] == names
    (rates,) = run_figures("", "quad", arrays, 0)["states"].axes
    assert rates.get_ylabel() == "qd" and len(rates.lines) == 3
    record: dict[str, Any] = {"command": "python -m experiments.simulate", **metrics}
    record |= channels_of(trajectory)
    assert units_of(trajectory)["srmse"] == ["m", "m", "rad"]
    head, *lines = summary(metrics, record["outputs"]).splitlines()
    for name, unit in (("x", "m"), ("y", "m"), ("pitch", "rad")):
        assert f"SRMSE x 10^3, {name} [{unit}]" in head and f"{name} after 10 s" in head
    assert len(lines) == 2 and f"{1e3 * metrics['srmse'][0][2]:.3f}" in lines[0]
    found, _ = measured(record)
    assert list(found)[:3] == ["srmse_x", "srmse_y", "srmse_pitch"]
    assert found["srmse_pitch"].mean == np.mean([row[2] for row in metrics["srmse"]])
    log_run(tmp_path, composed(()), arrays, metrics, {}, "python -m experiments.simulate a=b")
    scalars = set(logged(tmp_path).Tags()["scalars"])
    assert {"draw0/error_pitch", "draw1/side_thrust", "metrics/srmse_pitch"} <= scalars
    assert not any("attended" in tag or "weight" in tag for tag in scalars)


def test_wind_is_kept_and_drawn_below_the_inputs() -> None:
    loop, scenario = fed_back(PlanarQuadrotor(), 6)
    wind = Disturbance(plant=Sinusoid([3.0], 2.0))
    arrays = arrays_of(loop, dataclasses.replace(scenario, disturbance=wind))
    known = 3.0 * np.sin(2.0 * arrays["t"])
    np.testing.assert_allclose(arrays["disturbance"][:, 1, 0], known, atol=1e-14)
    assert "applied" not in arrays and "disturbance" not in arrays_of(loop, scenario)
    axes = inputs({"a": of_draws(arrays, 0)}, "").axes
    assert len(axes) == 4 and axes[3].get_ylabel() == "wind [m/s]"
    np.testing.assert_allclose(axes[3].lines[0].get_ydata(), known, atol=1e-14)


def test_what_a_reference_model_is_told_is_kept_beside_what_it_gives() -> None:
    loop, scenario = tank(Levelling(), model=LinearModel.first_order(5.0))
    arrays = arrays_of(loop, scenario)
    told = 0.5 + np.sin(0.7 * arrays["t"])
    np.testing.assert_allclose(arrays["command"][:, 0, 0], told, rtol=1e-14)
    assert (arrays["reference"][1:] < arrays["command"][1:]).all()  # a lag of a rising command
    np.testing.assert_array_equal(arrays["error"], arrays["reference"] - arrays["output"])
    top, _ = outputs({"a": of_draws(arrays, 0)}, "").axes
    assert [line.get_label() for line in top.lines[:3]] == ["a", "reference", "command"]


def test_motors_that_are_no_outputs_are_drawn_as_states() -> None:
    arrays = arrays_of(*fed_back(FlexibleJointArm(2), 4))
    assert arrays["output"].shape == (7, 2, 2) and arrays["q"].shape == (7, 2, 4)
    drawn = run_figures("", "flexible", arrays, 0)
    assert [ax.get_ylabel() for ax in drawn["states"].axes] == ["$q$", "qd"]
    assert len(drawn["outputs"].axes) == 4


def test_many_outputs_and_entries_are_wrapped_and_not_all_named() -> None:
    t, p = np.linspace(0, 1, 5), 5
    table = np.array([[f"y_{i}", "1"] for i in range(p)])
    rows = np.random.default_rng(0).normal(size=(5, p))
    run = {"t": t, "outputs": table, "output": rows, "reference": rows, "error": 0 * rows}
    run |= {"parameters": np.empty((0, 2), str), "wide": np.tile(t[:, None], (1, 40))}
    figure = outputs({"a": run}, "")
    assert len(figure.axes) == 2 * p and figure.axes[0].get_ylabel() == "$y_{0}$"
    (ax,) = traces(run, ["wide"], "").axes
    assert len(ax.lines) == 40 and len(ax.get_legend().get_texts()) == 10


@pytest.mark.parametrize(
    ("name", "text"),
    [("q_1", "$q_{1}$"), ("q_12", "$q_{12}$"), ("x", "$x$"), ("side_thrust", "side_thrust")],
)
def test_letters_are_written_as_mathematics(name: str, text: str) -> None:
    assert symbol(name) == text and symbol(name, {name: "own"}) == "own"
