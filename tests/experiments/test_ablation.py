"""The ablation: its draws, what its rows are, and a small run of all three tables."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import numpy as np
import pytest
import torch

from experiments import ablation
from experiments.ablating import arm, online
from experiments.learning.online_learners import OnlineLearner, samples
from experiments.learning.online_passes import TEST, one_pass
from experiments.peering.memory import MEMORIES
from experiments.sequence_tasks.streams import draw_stream
from experiments.settings.ablation_config import CELLS, AblationConfig, ArmTableConfig
from experiments.settings.memory_config import OnlineRegressionConfig
from tests.experiments.command import exit_code

SMALL = (
    "tables=[online,arm,recall]", "workers=1", "output.figures=false",
    "online.variants=[plain,readouts_3]", "online.visits=2", "online.visit_length=2",
    "online.rates=[10]", "online.seeds=2", "arm.variants=[plain,readouts_3]", "arm.draws=2",
    "arm.visits=2", "arm.visit_length=0.2", "arm.window=0.1", "arm.dt=1e-3", "arm.n_regimes=2",
    "recall.variants=[memory]", "recall.seeds=2", "recall.iterations=3",
)  # fmt: skip


@pytest.mark.slow
def test_a_small_run_has_a_table_each(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    folder = tmp_path / "run"
    assert exit_code(monkeypatch, ablation.main, *SMALL, f"run_dir={folder}") == 0
    with open(folder / "table.csv") as file:
        rows = list(csv.DictReader(file))
    assert {row["task"] for row in rows} == {"online", "arm", "recall"}
    assert json.loads((folder / "metrics.json").read_text())["table"]
    for table in ("online", "arm", "recall"):
        assert (folder / f"{table}.csv").exists()
        assert f"### {table}" in (folder / "report.md").read_text()
    with np.load(folder / "arrays.npz") as arrays:
        plain, other = arrays["arm/plain/after_return"], arrays["arm/readouts_3/after_return"]
    assert plain.shape == (2,) and np.isfinite(plain).all() and (plain != other).all()


def test_payloads_come_back_and_none_twice_running() -> None:
    cfg = ArmTableConfig(n_regimes=3, visits=4, draws=6)
    found = arm.drawn(cfg, seed=1)
    assert found.payloads.shape == (6, 12)
    for row in found.payloads:
        values, counts = row.unique(return_counts=True)
        assert counts.tolist() == [4, 4, 4]
        assert bool((values.diff() > 0.1).all()) and float(values.min()) >= 0.0
        assert float(values.max()) <= cfg.payload
        assert bool((row.diff() != 0.0).all())
    fewer = arm.drawn(ArmTableConfig(n_regimes=3, visits=4, draws=2), seed=1)
    assert torch.equal(fewer.payloads, found.payloads[:2])
    assert not torch.equal(found.payloads[0], found.payloads[1])


def test_the_second_mass_is_the_papers_and_the_payload() -> None:
    cfg = ArmTableConfig(draws=2, visits=2)
    draws = arm.drawn(cfg, seed=0)
    masses = arm.scenario(cfg, draws).schedule["masses"].values
    torch.testing.assert_close(masses[..., 1], 2.3 + draws.payloads)
    assert bool((masses[..., 0] == 0.8).all())


@pytest.mark.parametrize("variant", ["plain", "memory_1", "readouts_3", "memory_1_readouts_5"])
def test_a_variant_of_the_arm_has_the_slots_of_its_name(variant: str) -> None:
    controller = arm.loop_of(AblationConfig(arm=ArmTableConfig(rate=30.0)), variant).controller
    held = controller.approximator
    slots = 0 if held.memory is None else held.memory.n_slots
    readouts = 0 if held.readouts is None else held.readouts.n_slots
    assert (slots, readouts) == {
        "plain": (0, 0), "memory_1": (1, 0), "readouts_3": (0, 3), "memory_1_readouts_5": (1, 5),
    }[variant]  # fmt: skip
    assert float(controller.constant("rate_W")) == float(controller.constant("rate_V")) == 30.0


def test_every_cell_of_the_table_is_one_of_peers() -> None:
    assert set(CELLS) == set(MEMORIES)


def short(**settings: object) -> OnlineRegressionConfig:
    sizes = {"visit_length": 2.0, "visits": 2, "dt": 0.02, "seeds": 3, "spread": 0.5}
    return OnlineRegressionConfig(**{**sizes, **settings})  # type: ignore[arg-type]


def test_one_readout_is_the_plain_network_on_the_same_stream() -> None:
    """Whatever the number of slots is, streams and weights are the same."""
    one = one_pass(short(n_slots=1), "readouts", 10.0, TEST, 2, lambda n: None)
    plain = one_pass(short(n_slots=4), "network", 10.0, TEST, 2, lambda n: None)
    np.testing.assert_allclose(one.rmse, plain.rmse, rtol=1e-9)
    more = one_pass(short(n_slots=3), "readouts", 10.0, TEST, 2, lambda n: None)
    assert not np.allclose(more.rmse, plain.rmse, rtol=1e-3)


def test_wiping_leaves_the_mean_of_the_slots() -> None:
    cfg = short(n_slots=3)
    learner, generator = OnlineLearner(cfg, "readouts", 10.0), torch.Generator().manual_seed(0)
    stream = draw_stream(cfg.seeds, 2, generator)
    inputs, answers = samples(stream, 0, 40, generator)
    state = learner.begin(learner.start(cfg, generator), inputs[:3])
    fresh = state.readouts
    for x, y in zip(inputs, answers, strict=True):
        looked = learner.look(state, x, jump=True)
        state = learner.update(state, x, y - looked.prediction, looked)
    wiped = learner.wiped(state)
    mean = state.network.W + state.readouts.held.W.mean(dim=1)
    torch.testing.assert_close(wiped.network.W, mean)
    assert not torch.equal(state.readouts.held.W, fresh.held.W)
    assert torch.equal(wiped.readouts.held.W, fresh.held.W)


def test_rows_of_online_are_learners_of_online_regression() -> None:
    cfg = AblationConfig()
    cfg.online.rates = [10.0]
    found = {v: online.settings(cfg, v) for v in ("plain", "memory_1", "readouts_8", "wiped_5")}
    assert {v: (own.variants[0], own.n_slots, own.wiped) for v, own in found.items()} == {
        "plain": ("network", 1, False), "memory_1": ("hard", 1, False),
        "readouts_8": ("readouts", 8, False), "wiped_5": ("readouts", 5, True),
    }  # fmt: skip
