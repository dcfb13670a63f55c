"""Every registered name has a file in conf, and what a file says is what its class is given."""

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import torch
from omegaconf import OmegaConf

import mann_torch as mt
from experiments.building.build import Experiment, build
from experiments.building.controllers import paper_constants
from experiments.building.ensembles import composed
from experiments.building.made import made
from experiments.building.plants import build_plant
from experiments.building.schedules import schedule
from experiments.command.cli import compose_job
from experiments.command.conf_files import CONF, group_names
from experiments.settings.config import SimulateConfig
from mann_torch.control import BASES, CONTROLLERS, LAW_PARTS, LAWS, NETWORKS
from mann_torch.errors import ConfigError
from mann_torch.memory import ATTENTIONS
from mann_torch.parts import MODELS
from mann_torch.plants import PLANTS
from mann_torch.registry import Registry
from mann_torch.signals import REFERENCES

PENDULUM = ("plant=pendulum", "scenario=plain")
ROW = torch.tensor([0.8, 2.3], dtype=torch.float64)


def made_of(*overrides: str) -> Experiment:
    return build(composed(overrides))


@pytest.mark.parametrize(
    ("group", "registry"),
    [
        *(("plant", PLANTS), ("reference", REFERENCES), ("model", MODELS)),
    ],
)
def test_every_registered_name_has_a_file(group: str, registry: Registry[Any]) -> None:
    assert group_names(group) == sorted(registry)
    for name in registry:
        assert OmegaConf.load(CONF / group / f"{name}.yaml").name == name


def test_networks_laws_and_their_parts_have_files() -> None:
    nodes = {
        group: [OmegaConf.load(path) for path in (CONF / group).glob("*.yaml")]
        for group in ("network", "law")
    }
    assert {node.name for node in nodes["network"]} == set(NETWORKS)
    bases = {node.basis.name for node in nodes["network"] if "basis" in node}
    assert bases == {*BASES, "plant"}
    assert {node.name for node in nodes["law"]} == set(LAWS)
    parts = {key for node in nodes["law"] if node.name == "adaptive" for key in node}
    assert parts - {"name"} == set(LAW_PARTS)


def test_every_kind_of_controller_has_a_file() -> None:
    files = [OmegaConf.load(path) for path in (CONF / "controller").glob("*.yaml")]
    assert {file.kind for file in files} == set(CONTROLLERS)


def test_the_papers_constants_are_those_of_its_controllers_and_their_defaults() -> None:
    told = OmegaConf.to_container(OmegaConf.load(CONF / "constants" / "paper.yaml"))
    assert isinstance(told, dict) and set(told) == paper_constants()
    loop = made_of("controller=reallocating_initial", "keys=state").loop
    for name, value in (
        mt.MannController(
            2,
            10,
            mt.WorkingMemory(5, 10, mt.ReallocatingAttention(), mt.StateKeys(), context_width=2),
        )
        .constants()
        .items()
    ):
        assert torch.equal(loop.constant(name), value), name


@pytest.mark.parametrize("name", [name for name in PLANTS if name not in ("linear", "rohrs")])
def test_a_plants_file_says_what_its_class_does(name: str) -> None:
    told, parameters = build_plant(
        OmegaConf.to_container(OmegaConf.load(f"{CONF}/plant/{name}.yaml"))
    )
    plant = PLANTS[name]()
    for own, default in zip(parameters, plant.parameters_of(), strict=True):
        assert torch.equal(own, default)
    assert (told.inputs, told.outputs) == (plant.inputs, plant.outputs)
    for key, value in vars(plant).items():
        if isinstance(value, int | float | str):
            assert getattr(told, key) == value, key


@pytest.mark.parametrize("name", REFERENCES)
def test_every_reference_drives_a_plant_of_one_output(name: str) -> None:
    scenario = made_of(*PENDULUM, f"reference={name}", "model=second_order").scenario
    assert type(scenario.reference) is REFERENCES[name] and scenario.reference.width == 1


def test_a_spline_goes_through_the_samples_of_a_file(tmp_path: Path) -> None:
    path = tmp_path / "way.csv"
    path.write_text("t,q\n0,0.1\n1,0.4\n2,-0.2\n3,0\n")
    for degree in (3, 5):
        how = ("reference=spline", f"reference.path={path}", f"reference.degree={degree}")
        reference = made_of(*PENDULUM, *how).scenario.reference
        at = reference(torch.tensor([0.0, 1.0, 2.0, 3.0], dtype=torch.float64)).value
        assert at[:, 0].tolist() == pytest.approx([0.1, 0.4, -0.2, 0.0], abs=1e-12)


def test_a_large_number_is_no_size() -> None:
    heavy = made_of(*PENDULUM, "plant.mass=5000", "scenario.start.q=2000").scenario
    assert heavy.parameters.mass.tolist() == [5000.0] and heavy.start.q.tolist() == [2000.0]
    with pytest.raises(ConfigError, match=r"plant.n_joints = 5000: at most 1000"):
        made_of("plant=n_link_arm", "scenario=plain", "plant.n_joints=5000")


def test_an_attention_of_ones_own_has_its_arguments(monkeypatch: pytest.MonkeyPatch) -> None:
    class Sharp(mt.SoftAttention):
        def __init__(self, sharpness: float = 1.0) -> None:
            super().__init__()
            self.sharpness = sharpness

    monkeypatch.setitem(ATTENTIONS, "sharp", Sharp)
    controller = made_of("controller=soft", "controller.attention=sharp", "controller.sharpness=3")
    assert controller.loop.controller.memory.attention.sharpness == 3  # type: ignore[attr-defined]
    with pytest.raises(ConfigError, match=r"did you mean controller.sharpness\?"):
        made_of("controller=soft", "controller.attention=sharp", "controller.sharpnes=3")


def test_one_number_stands_for_all_outputs() -> None:
    reference = made_of("plant=n_link_arm", "scenario=plain").scenario.reference
    value = reference(torch.tensor(0.3, dtype=torch.float64)).value
    assert value.tolist() == [0.5 * math.sin(0.3)] * 3


def test_a_reference_that_is_chosen_replaces_the_scenarios() -> None:
    chosen = made_of("scenario='2'", "reference=sinusoid", "reference.amplitude=[0.1,0.2]")
    own = made_of("scenario='2'", "scenario.reference.amplitude=[0.1,0.2]")
    t = torch.tensor(2.0, dtype=torch.float64)
    assert torch.equal(chosen.scenario.reference(t).value, ROW.new_tensor([0.1, 0.2]) * t.sin())
    offset = ROW.new_tensor([0.0, 0.1])
    wave = ROW.new_tensor([0.1, 0.2]) * (0.5 * t).sin()
    assert torch.equal(own.scenario.reference(t).value, offset + wave)


@pytest.mark.parametrize(
    ("changes", "rows"),
    [
        ([[1, 2]], [[1.6, 4.6]]),
        ([[1, "sqrt(4)"], [2, [1, 0.5]]], [[1.6, 4.6], [1.6, 2.3]]),
        ([{"at": 1, "add": 0.5, "entry": 2}], [[0.8, 2.8]]),
        ([{"at": 1, "add": [0.2, 0]}, {"at": 3, "value": 7, "entry": 1}], [[1.0, 2.3], [7, 2.3]]),
        ([{"at": 1, "value": [3, 4]}, [2, 0.5]], [[3, 4], [1.5, 2]]),
        ([{"at": 1, "factor": 3, "entry": 1}], [[2.4, 2.3]]),
        ([{"every": 4, "growth": 3}], [[1.6, 4.6], [0.8 * 7**0.5, 2.3 * 7**0.5]]),
    ],
)
def test_changes_of_a_row_of_an_entry_relative_or_not(changes: list[Any], rows: Any) -> None:
    times, values = schedule("masses", changes, ROW, 10.0)
    assert len(times) == len(rows) and torch.equal(values[0], ROW)
    torch.testing.assert_close(
        values[1:], torch.tensor(rows, dtype=torch.float64), rtol=1e-15, atol=0
    )
    many = schedule("masses", changes, torch.stack([2 * ROW, ROW]), 10.0)[1]
    assert torch.equal(many[1], values)  # of a batch, each row as alone


def test_any_parameter_of_any_plant_moves_by_name_and_entry() -> None:
    made = made_of(
        *("plant=n_link_arm", "scenario=plain", "plant.masses=2"),
        "scenario.schedule.masses=[{at:1,add:0.5,entry:3}]",
        "scenario.schedule.viscous=[{at:2,value:0.1}]",
        "scenario.start.q=[0.1,0.2,0.3]",
    )
    t = torch.tensor([0.5, 1.0, 2.5], dtype=torch.float64)
    moved = made.scenario.parameters_at(t)
    assert moved.masses.tolist() == [[2, 2, 2], [2, 2, 2.5], [2, 2, 2.5]]
    assert moved.viscous.tolist() == [[0] * 3, [0] * 3, [0.1] * 3]
    assert made.scenario.start.q.tolist() == [0.1, 0.2, 0.3]
    assert made.scenario.start.qd.tolist() == [0] * 3


def test_every_part_is_of_the_plants_size_and_has_what_was_said() -> None:
    loop = made_of(
        *(*PENDULUM, "actuator=lagged", "actuator.limit=4", "sensor=sampled", "clock.period=0.02"),
        *("sensor.period=null", "sensor.delay=0.04", "sensor.quantum=1e-3", "model=second_order"),
        *("model.damping=0.7", "constants.lag=[0.1]", "constants.rate_W=3", "clock.hold=first"),
    ).loop
    assert loop.constant("upper").tolist() == [4.0] and loop.constant("lag").tolist() == [0.1]
    assert loop.clock is not None and (loop.clock.period, loop.clock.hold) == (0.02, "first")
    assert loop.sensor is not None and loop.sensor.samples(0.02) == (0.02, 2)
    assert loop.constant("damping").tolist() == [0.7] and float(loop.constant("rate_W")) == 3.0


def test_parts_are_absent_by_default() -> None:
    made = made_of()
    loop, scenario = made.loop, made.scenario
    assert (loop.actuator, loop.sensor, loop.clock, loop.model) == (None,) * 4
    assert scenario.noise is None and scenario.disturbance is None and scenario.start is None
    assert made_of("sensor=noisy").loop.sensor is None  # noise alone is no sampling


def test_a_draws_noise_is_its_own_whatever_is_drawn_beside_it() -> None:
    many = made_of("sensor=noisy", "draws=5").scenario.noise
    one = made_of("sensor=noisy", "initial.draw=3").scenario.noise
    assert many is not None and one is not None
    assert many.seed.tolist() == [1000, 1001, 1002, 1003, 1004] and one.seed.tolist() == [1003]


def test_disturbances_have_the_width_of_what_they_act_on() -> None:
    quadrotor = ("plant=planar_quadrotor", "scenario=plain")
    for name, width in {"input": 3, "output": 6, "state": 6, "wind": 1}.items():
        scenario = made_of(*quadrotor, "controller=hard", f"disturbance={name}").scenario
        assert scenario.disturbance is not None
        assert list(scenario.disturbance.widths().values()) == [width]


def test_any_network_under_any_law() -> None:
    made = made_of(
        *(*PENDULUM, "controller=hard", "network=radial_basis", "law=gradient"),
        *("law.constant.adaptation_rate=7", "controller.n_hidden=12", "network.basis.seed=4"),
    )
    network = made.loop.controller.network  # type: ignore[attr-defined]
    assert isinstance(network, mt.control.LinearNetwork) and network.n_hidden == 12
    assert isinstance(network.basis, mt.control.RadialBasis) and network.n_inputs == 5
    assert float(made.loop.constant("adaptation_rate")) == 7.0
    assert made.weights.W.shape == (1, 12, 1)


def test_constants_go_to_whatever_part_has_them() -> None:
    made = made_of(*PENDULUM, "controller=linear_feedback", "constants.feedback=[3,1]", "draws=4")
    assert made.loop.constant("feedback").tolist() == [3.0, 1.0]
    assert made.weights is None and made.scenario.batch_shape == (4,)


class Own:
    """Something with two ways to be made."""

    def __init__(self, size: int, gain: float = 1.0) -> None:
        self.told = (size, gain)

    @classmethod
    def twice(cls, half: int) -> "Own":
        """By its half."""
        return cls(2 * half)


def test_arguments_choose_the_constructor() -> None:
    assert made("own", Own, {"gain": 3.0}, {"size": 2}).told == (2, 3.0)
    assert made("own", Own, {"half": 3}, {}).told == (6, 1.0)
    assert made("own", Own, {"size": 5}, {"size": 2}).told == (5, 1.0)
    with pytest.raises(ConfigError, match=r"unknown setting 'own.gian'; did you mean own.gain\?"):
        made("own", Own, {"gian": 1}, {"size": 1})
    with pytest.raises(ConfigError, match=r"own.size is missing: Own asks for it"):
        made("own", Own, {}, {})


def test_the_papers_scenarios_in_a_study_are_those_of_simulate() -> None:
    """The scenario's settings come before the study's, and nothing else is changed."""
    from experiments.building.ensembles import in_scenario
    from experiments.settings.study_config import TuneConfig

    study = OmegaConf.to_object(
        compose_job("tune", ["plant.viscous=[0.1,0.1]", "plant.lengths=[3,3]"])
    )
    assert isinstance(study, TuneConfig)
    for name in ("1", "3", "6"):
        here = in_scenario(study, name)
        alone = composed((f"scenario='{name}'", "plant.viscous=[0.1,0.1]", "sensor=noisy"))
        lengths = [1.0, 2.0] if name == "6" else [3, 3]
        assert here.plant == {**alone.plant, "lengths": lengths}
        # What a study asks of a problem is its own.
        assert here == replace(alone, plant=here.plant, problem=here.problem)
        assert isinstance(here, SimulateConfig)
