"""What is typed and nothing uses is refused; what anything uses, even by its size, is not."""

from __future__ import annotations

import functools
from pathlib import Path

import pytest
import torch
from torch import nn

from experiments.building.what_runs import LOOP_NODES, what_runs
from experiments.command.cli import compose_job
from experiments.command.conf_files import group_names
from experiments.command.overrides import jobs_of, opened, quote_numeric_names
from experiments.command.unused import Typed, changed, same
from experiments.simulate import main
from mann_torch.errors import ConfigError
from tests.experiments.command import exit_code

LINEAR = "plant=pendulum scenario=plain controller=linear_feedback"
UNUSED = {
    "controller=nn memory.reset=raw": "memory.reset",
    "controller=nn controller.n_hidden=10 memory.n_slots=3": "memory.n_slots",
    f"{LINEAR} memory.n_slots=3": "memory.n_slots",
    f"{LINEAR} initial.std=0.3": "initial.std",
    "controller=nn keys=state": "keys",
    "controller=nn constants.write_gain=1": "constants.write_gain",
    "controller=soft controller.phase=always": "controller.phase",
    "controller=hard controller.matched_hidden=12": "controller.matched_hidden",
    "plant=pendulum scenario=plain scenario.reference.amplitude=1 reference=quintic": (
        "scenario.reference.amplitude"
    ),
    "scenario.horizon=20 horizon=5": "scenario.horizon",
    "problem.effort_after=3": "problem.effort_after",
    "-m controller=nn scenario=1,2 constants.write_gain=1": "constants.write_gain",
}
USED = (
    "controller=nn memory.n_slots=3",  # as many neurons as a memory of 3 slots is worth
    "controller=nn memory.n_slots=2",  # and where that is the same number as of 3
    "controller=soft keys=state",
    "memory.n_slots=5",  # what there is anyway
    "scenario=plain scenario.horizon=10",
    "scenario=plain controller=computed_torque controller.nominal.masses=[1,1]",  # the plant's
    "sensor.noise.std=[0.0]",
    f"{LINEAR} initial.draw=3",
    "-m controller=nn,soft constants.write_gain=1",  # by one of them
    "controller=soft network=radial_basis law=gradient controller.n_hidden=12",
    "problem=wing_rock law.sigma.sigma=0.1",
    "controller.name=mine",
)


def refuse_unused(line: str, command: str = "simulate") -> None:
    jobs = list(map(opened, jobs_of(quote_numeric_names(line.split()))))
    compose = functools.partial(compose_job, command)
    Typed(jobs, [compose(job) for job in jobs], compose, what_runs).check_used(LOOP_NODES)


@pytest.mark.parametrize("line", UNUSED)
def test_what_nothing_uses_is_named(line: str) -> None:
    with pytest.raises(ConfigError, match=rf"nothing that is chosen here uses {UNUSED[line]}"):
        refuse_unused(line)


@pytest.mark.parametrize("line", USED)
def test_what_anything_uses_is_accepted(line: str) -> None:
    refuse_unused(line)


def test_a_study_asks_for_what_a_single_run_does_not() -> None:
    on = {"gradient_report": "scenario=plain", "tune": "train.scenarios=[plain]"}
    on["tune"] += " held_out.scenarios=[plain]"
    for command, where in on.items():
        refuse_unused(f"{where} problem.effort_after=3", command)
        with pytest.raises(ConfigError, match=r"uses memory\.reset"):
            refuse_unused(f"{where} controller=nn memory.reset=raw", command)


def test_it_is_one_line_and_exit_code_2(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    assert exit_code(monkeypatch, main, "controller=nn", "memory.reset=raw") == 2
    assert capsys.readouterr().err == (
        "error: memory.reset=raw: nothing that is chosen here uses memory.reset; the run would be "
        "the same without it\n"
    )
    assert not any(tmp_path.iterdir())


def test_a_run_says_how_many_neurons_it_has_where_they_follow(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    quick = ("horizon=0.02", "output.figures=false", "output.tensorboard=false")
    assert exit_code(monkeypatch, main, "controller=nn", "memory.n_slots=3", *quick) == 0
    assert "scenario 1, nn, 12 neurons, implicit" in capsys.readouterr().out


def test_every_problem_is_like_itself_and_no_other() -> None:
    """Were one unlike itself, nothing that is typed beside it could be found to be of no use."""
    made = {}
    for name in group_names("problem")[::5]:
        cfg = compose_job("simulate", [f"problem={name}"])
        made[name] = what_runs(cfg)
        assert same(made[name], what_runs(cfg)), name
    for name, others in zip(made, [*list(made)[1:], next(iter(made))], strict=True):
        assert not same(made[name], made[others]), (name, others)


def test_things_are_alike_part_by_part() -> None:
    def by(factor: float) -> object:
        return lambda x: factor * x

    one, other = nn.Linear(2, 1), nn.Linear(2, 1)
    other.load_state_dict(one.state_dict())
    assert same(one, other) and same(by(2.0), by(2.0)) and same({"a": [1, (2,)]}, {"a": [1, (2,)]})
    assert not same(by(2.0), by(3.0)) and not same([1], [1, 2]) and not same(1, 1.0)
    with torch.no_grad():
        other.bias += 1
    assert not same(one, other)
    assert changed({"a": [1, "x", True], "b": 0.5}, 2, 1) == {"a": [3, "x", False], "b": 2.0}
