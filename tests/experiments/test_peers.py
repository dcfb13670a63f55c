"""Models of equal size, trainings, and the command that compares them."""

import csv
import json
from pathlib import Path

import numpy as np
import pytest
import torch

from experiments import peers
from experiments.peering import titans
from experiments.peering.figures import curves_over
from experiments.peering.models import build_model, matched_size, n_parameters, sized
from experiments.peering.report import measured, stacked
from experiments.peering.training import Learned, first_near_best, learn, n_iterations
from experiments.sequence_tasks.every import TASKS
from experiments.settings.peers_config import PEERS, GapConfig, PeersConfig, RecallConfig
from tests.experiments.command import exit_code, logged

VARIANTS = [v for v in PEERS if v != "titans" or titans.is_installed()]
SHORT = ["seeds=2", "workers=1", "tested=10", "evaluated=5", "every=2", "shares={lstm:1,titans:1}"]
SHORT += [f"{task}.{what}" for task in TASKS for what in ("iterations=3", "batch=2")]
SHORT += ["gap.longest=12", "copy.gap=3", "hidden_size=6", "n_slots=3"]


@pytest.mark.parametrize("name", TASKS)
def test_widths_are_those_whose_parameters_are_nearest_to_the_memorys(name: str) -> None:
    cfg = PeersConfig()
    task = TASKS[name](cfg)
    target = n_parameters(build_model(cfg, task, "memory", 0))
    for variant in VARIANTS:
        size, step = matched_size(cfg, task, variant), 2 if variant == "attention" else 1
        counts = [
            n_parameters(sized(cfg, task, variant, s))
            for s in (size - step, size, size + step)
            if s > 0
        ]
        gaps = [abs(count - target) for count in counts]
        assert variant == "memory" or gaps[-2] == min(gaps), variant
        assert n_parameters(build_model(cfg, task, variant, 1)) == counts[-2]
        assert gaps[-2] < 0.25 * target, variant


@pytest.mark.parametrize("variant", VARIANTS)
@torch.no_grad()
def test_no_model_sees_what_comes_later_or_after_the_end(variant: str) -> None:
    cfg = PeersConfig(hidden_size=8, gap=GapConfig(longest=12, shortest=3))
    task = TASKS["gap"](cfg)
    batch = task.draw(3, torch.Generator().manual_seed(0))
    model = build_model(cfg, task, variant, 5)
    whole = model(batch.x, None)
    changed = batch.x.clone()
    changed[7:] += 1.0
    later = model(changed, None)
    torch.testing.assert_close(whole[:7], later[:7], rtol=1e-5, atol=1e-5)
    assert float((whole[7:] - later[7:]).abs().max()) > 1e-4
    assert batch.valid is not None
    padded = model(batch.x, batch.valid)
    for b in range(3):
        length = int(batch.valid[:, b].sum())
        alone = model(batch.x[:length, b : b + 1], None)[:, 0]
        torch.testing.assert_close(padded[:length, b], alone, rtol=1e-5, atol=1e-5)


@pytest.mark.parametrize("variant", VARIANTS)
def test_the_seed_alone_sets_first_weights_and_all_of_them_learn(variant: str) -> None:
    cfg = PeersConfig(hidden_size=8)
    task = TASKS["recall"](cfg)
    batch = task.draw(4, torch.Generator().manual_seed(0))
    first, same, other = (build_model(cfg, task, variant, seed) for seed in (1, 1, 2))
    outputs = [model(batch.x, None) for model in (first, same, other)]
    assert torch.equal(outputs[0], outputs[1]) and not torch.equal(outputs[0], outputs[2])
    task.loss(outputs[0], batch).backward()
    for name, parameter in first.named_parameters():
        if parameter.requires_grad and parameter.numel():
            assert parameter.grad is not None and bool(parameter.grad.isfinite().all()), name


def test_a_training_ends_when_all_is_right_twice_running() -> None:
    cfg = PeersConfig(
        rates={"lstm": 0.01}, gap=GapConfig(shortest=2, longest=4, iterations=400), tested=500
    )
    told: list[int] = []
    found = learn(cfg, "gap", "lstm", 0, told.append)
    assert found.score > 0.99 and found.curve[-2:].tolist() == [1.0, 1.0]
    assert not (found.curve[:-2] == 1.0).any() or found.curve[-3] < 1.0
    assert found.at[0] == 0 and found.at[-1] < 400 and bool((np.diff(found.at) == 20).all())
    assert bool((np.diff(found.seconds) > 0).all()) and sum(told) == 400
    again = learn(cfg, "gap", "lstm", 0)
    np.testing.assert_array_equal(found.curve, again.curve)


@pytest.mark.slow
def test_a_short_training_of_the_cell_beats_what_can_be_had_without_matching_keys() -> None:
    cfg = PeersConfig(
        **{"hidden_size": 16, "n_slots": 3, "rates": {"memory": 0.01}},
        recall=RecallConfig(n_keys=3, n_values=2, n_pairs=2, iterations=120, batch=64),
    )
    found = learn(cfg, "recall", "memory", 0)
    known = TASKS["recall"](cfg).known(TASKS["recall"](cfg).draw(2000, torch.Generator()))
    assert found.score > 0.95 > max(known.values())
    assert found.trace["weights"].shape == (4, 3)
    np.testing.assert_allclose(found.trace["weights"].sum(-1), 1.0, atol=1e-6)


def test_what_comes_near_the_best_first() -> None:
    assert first_near_best(np.array([0.1, 0.985, 0.99, 0.995]), False) == 1
    assert first_near_best(np.array([0.1, 0.98, 0.97]), False) == 1
    assert first_near_best(np.array([0.5, 0.2, 0.1009, 0.1, 0.3]), True) == 2
    assert first_near_best(np.array([0.5, np.nan]), False) == -1


def made_up(curve: list[float], every: int = 20) -> Learned:
    steps = np.arange(len(curve))
    return Learned(curve[-1], np.array(curve), every * steps, 0.5 * steps, 0.1, 8, 100, {})


def test_measures_and_curves_of_made_up_trainings() -> None:
    runs = [made_up([0.1, 0.4, 0.9, 0.9]), made_up([0.3, 1.0, 1.0])]
    found = measured(TASKS["copy"](PeersConfig()), runs)
    np.testing.assert_allclose(found["score"], [0.9, 1.0])
    np.testing.assert_allclose(found["training_s"], [1.5, 1.0])
    np.testing.assert_allclose(found["best_s"], [1.0, 0.5])
    np.testing.assert_allclose(found["best_iterations"], [40, 20])
    mean, _ = curves_over(runs, np.array([0.0, 0.6, 1.4, 9.0]), "seconds")
    np.testing.assert_allclose(mean, [0.2, 0.7, 0.95, 0.95])
    curve = stacked(runs)["curve"]
    assert curve.shape == (2, 4) and np.isnan(curve[1, 3]) and curve[1, 2] == 1.0
    lost = measured(TASKS["copy"](PeersConfig()), [made_up([0.1, np.nan]), runs[1]])
    assert np.isnan(lost["score"][0]) and np.isnan(lost["best_s"][0]) and lost["best_s"][1] == 0.5


def test_a_share_is_one_of_the_tasks_iterations() -> None:
    cfg = PeersConfig(shares={"titans": 0.25, "lstm": 3.0})
    assert [n_iterations(cfg, "copy", v) for v in ("titans", "lstm", "gru")] == [100, 1200, 400]


@pytest.mark.slow
@pytest.mark.parametrize("there", [True, False])
def test_a_short_run_writes_everything_with_titans_or_without(
    there: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    if there and not titans.is_installed():
        pytest.skip("titans-pytorch is not installed")
    monkeypatch.setattr(titans, "is_installed", lambda: there)
    monkeypatch.chdir(tmp_path)
    folder = tmp_path / "run"
    arguments = [*SHORT, "member=1", f"run_dir={folder}"]
    if there:
        arguments += ["tasks=[recall]", "variants=[lstm,titans]"]
    else:
        arguments += ["output.dpi=40"]
    assert exit_code(monkeypatch, peers.main, *arguments) == 0
    tasks, variants = (["recall"], ["lstm", "titans"]) if there else (list(TASKS), list(PEERS))
    with open(folder / "table.csv") as file:
        rows = list(csv.DictReader(file))
    assert [(row["task"], row["variant"]) for row in rows] == [
        (task, variant) for task in tasks for variant in variants
    ]
    for row in rows:
        gone = row["variant"] == "titans" and not there
        assert (row["score"] == "nan") == gone
        assert ("not installed" in row["score_verdict"]) == gone
    metrics = json.loads((folder / "metrics.json").read_text())
    assert len(metrics["table"]) == len(rows)
    report = (folder / "report.md").read_text()
    assert metrics["command"] in report and ("not installed" in report) != there
    with np.load(folder / "arrays.npz") as arrays:
        assert arrays["recall/lstm/score"].shape == (2,)
        assert arrays["recall/lstm/curve"].shape == (2, 3)
        assert arrays["recall/lstm/iterations"].tolist() == [[0, 2, 3]] * 2
        if not there:
            length = len(arrays["gap/memory/weights"])
            assert 10 <= length <= 12 and arrays["gap/memory/mu"].shape == (length, 3, 6)
    tags = logged(folder).Tags()
    assert "learning" in tags["images"] and (folder / "learning.png").exists()
    assert there or "memory_copy" in tags["images"]
    assert "recall/lstm" in tags["scalars"] and "result/recall/lstm/score" in tags["scalars"]


@pytest.mark.parametrize(
    ("bad", "said"),
    [
        ("variants=[]", "at least one"),
        ("tasks=[sorting]", "unknown task 'sorting'"),
        ("recall.n_pairs=9", "recall.n_pairs"),
        ("rates.lstm=0", "rates.lstm"),
        ("recall.n_keys=10000000000000", "recall.n_keys"),
        ("seeds=99999999999999999999", "seeds"),
        ("copy.iterations=0", "copy.iterations"),
        ("gap.shortest=101", "gap.shortest"),
        ("returning.steps=43", "returning.steps"),
        ("shares={lstn:2}", "lstn"),
        ("workers=0", "workers"),
        ("member=1000", "member"),
        ("+speed=1", "unknown setting 'speed'"),
        ("+copy.speed=1", "speed"),
    ],
)
def test_bad_input_is_one_line_and_code_2(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capfd: pytest.CaptureFixture[str],
    bad: str,
    said: str,
) -> None:
    monkeypatch.chdir(tmp_path)
    assert exit_code(monkeypatch, peers.main, bad) == 2
    message = capfd.readouterr().err
    assert said in message and len(message.strip().splitlines()) == 1
    assert not list(tmp_path.iterdir())


def test_a_variant_without_a_rate_is_named(
    monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    assert exit_code(monkeypatch, peers.main, "~rates.gru") == 2
    assert "rates: none for gru" in capfd.readouterr().err
