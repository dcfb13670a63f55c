"""The two learning experiments: short runs of all of them, and what they refuse."""

import csv
import json
from pathlib import Path

import numpy as np
import pytest
import torch
from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

from experiments import online_regression, recall
from experiments.memory_config import RecallConfig
from experiments.memory_report import verdict
from experiments.online_learners import VARIANTS as LEARNERS
from experiments.recall_models import VARIANTS, build_model, n_parameters, sequences, without_keys
from tests.experiments.command import exit_code

SHORT_REGRESSION = ["visit_length=1", "visits=2", "window=0.5", "dt=0.05", "seeds=2"]
SHORT_RECALL = ["iterations=50", "longer=1", "seeds=2", "workers=1", "batch=2", "n_pairs=2"]


@pytest.mark.parametrize(
    ("module", "short", "variants"),
    [(online_regression, SHORT_REGRESSION, LEARNERS), (recall, SHORT_RECALL, VARIANTS)],
)
def test_a_short_run_writes_everything(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, module: object, short: list[str], variants: str
) -> None:
    monkeypatch.chdir(tmp_path)
    folder = tmp_path / "run"
    assert exit_code(monkeypatch, module.main, *short, "member=1", f"run_dir={folder}") == 0
    with open(folder / "table.csv") as file:
        rows = list(csv.DictReader(file))
    assert {row["variant"] for row in rows} == set(variants)
    metrics = json.loads((folder / "metrics.json").read_text())
    assert len(metrics["table"]) == len(variants)
    assert metrics["command"] in (folder / "report.md").read_text()
    assert (folder / "memory.png").exists() and (folder / "config.yaml").exists()
    with np.load(folder / "arrays.npz") as arrays:
        for variant in ("soft", "hard"):
            weights = arrays[f"{variant}/weights"]
            np.testing.assert_allclose(weights.sum(-1), 1.0, atol=1e-12)
            assert arrays[f"{variant}/mu"].shape[:2] == weights.shape
            assert len(arrays[f"{variant}/reallocation_step"]) == 0
    logged = EventAccumulator(str(folder), size_guidance={"images": 0}).Reload()
    assert "memory" in logged.Tags()["images"]
    assert {f"{v}/" for v in variants} == {
        tag.split("/")[0] + "/" for tag in logged.Tags()["scalars"] if tag.count("/") == 1
    }
    assert exit_code(monkeypatch, module.main, *short, f"run_dir={folder}") == 2


@pytest.mark.parametrize(
    ("module", "bad", "said"),
    [
        (online_regression, "variants=[tablet]", "unknown variant 'tablet'"),
        (online_regression, "dt=0.5", "window"),
        (online_regression, "rate=nan", "rate"),
        (online_regression, "member=20", "member"),
        (online_regression, "shift_threshold=-1", "shift_threshold"),
        (recall, "variants=[]", "at least one"),
        (recall, "n_pairs=9", "n_pairs"),
        (recall, "rate=0", "rate"),
        (recall, "+speed=1", "unknown setting 'speed'"),
    ],
)
def test_bad_input_is_one_line_and_code_2(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capfd: pytest.CaptureFixture[str],
    module: object,
    bad: str,
    said: str,
) -> None:
    monkeypatch.chdir(tmp_path)
    assert exit_code(monkeypatch, module.main, bad) == 2
    message = capfd.readouterr().err
    assert said in message and len(message.strip().splitlines()) == 1
    assert not list(tmp_path.iterdir())


def test_recall_has_one_right_answer_and_equal_parameters() -> None:
    cfg = RecallConfig()
    x, answer = sequences(cfg, 50, torch.Generator().manual_seed(0))
    P, K = cfg.n_pairs, cfg.n_keys
    for b in range(50):
        shown = {int(row[:K].argmax()): int(row[K:-1].argmax()) for row in x[:P, b]}
        assert len(shown) == P and bool((x[:P, b, -1] == 0).all())
        asked = [int(row[:K].argmax()) for row in x[P:, b]]
        assert [shown[key] for key in asked] == answer[:, b].tolist()
        assert bool((x[P:, b, K:-1] == 0).all())
    assert 1 / P < without_keys(answer) < 0.5
    sizes = {v: n_parameters(build_model(cfg, v)) for v in VARIANTS}
    cells = {sizes[v] for v in ("soft", "hard", "reallocating", "relaxed")}
    assert len(cells) == 1
    assert all(abs(size / max(cells) - 1) < 0.08 for size in sizes.values()), sizes


def test_a_short_training_of_the_cell_beats_what_can_be_had_without_matching_keys() -> None:
    cfg = RecallConfig(n_keys=3, n_values=2, n_pairs=2, n_slots=3, iterations=120)
    found = recall.learn(cfg, "soft", 0)
    answer = sequences(cfg, 2000, torch.Generator().manual_seed(0))[1]
    assert found.accuracy > 0.95 > without_keys(answer)


def test_verdicts_are_paired() -> None:
    base = np.array([1.0, 2.0, 3.0, 4.0])
    assert verdict(base - [0.1, 0.11, 0.1, 0.09], base, lower_is_better=True) == "better"
    assert verdict(base - [-0.1, -0.11, -0.1, -0.09], base, lower_is_better=True) == "worse"
    assert verdict(base - [0.1, -0.1, 0.1, -0.1], base, lower_is_better=True) == "no difference"
    assert verdict(base[:1], base[:1], lower_is_better=True) == "too few seeds to tell"
