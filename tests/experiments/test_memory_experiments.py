"""The two learning experiments: short runs of all of them, and what they refuse."""

import csv
import json
from pathlib import Path

import numpy as np
import pytest
import torch
from experiments.learning.recall_models import (
    Recurrent,
    build_model,
    n_parameters,
    sequences,
    without_keys,
)
from torch import nn

from experiments import online_regression, recall
from experiments.learning.online_learners import draw_stream
from experiments.learning.online_measures import measured
from experiments.learning.report import Measure, compare, verdict
from experiments.settings.memory_config import (
    LEARNERS,
    RECALLERS,
    OnlineRegressionConfig,
    RecallConfig,
)
from tests.experiments.command import exit_code, logged

SHORT_REGRESSION = ["visit_length=1", "visits=2", "window=0.5", "dt=0.05", "seeds=2", "workers=1"]
SHORT_REGRESSION += ["rates=[1,2]"]
SHORT_RECALL = ["iterations=50", "longer=1", "seeds=2", "workers=1", "batch=2", "n_pairs=2"]


@pytest.mark.parametrize(
    ("module", "short", "variants"),
    [(online_regression, SHORT_REGRESSION, LEARNERS), (recall, SHORT_RECALL, RECALLERS)],
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
        assert arrays["soft/accuracy" if module is recall else "soft/steady"].shape == (2,)
        for variant in ("soft", "hard"):
            weights = arrays[f"{variant}/weights"]
            np.testing.assert_allclose(weights.sum(-1), 1.0, atol=1e-12)
            assert arrays[f"{variant}/mu"].shape[:2] == weights.shape
            assert len(arrays[f"{variant}/reallocation_step"]) == 0
    log = logged(folder)
    assert "memory" in log.Tags()["images"]
    assert {f"{v}/" for v in variants} == {
        tag.split("/")[0] + "/" for tag in log.Tags()["scalars"] if tag.count("/") == 1
    }
    assert exit_code(monkeypatch, module.main, *short, f"run_dir={folder}") == 2


@pytest.mark.parametrize(
    ("module", "bad", "said"),
    [
        (online_regression, "variants=[tablet]", "unknown variant 'tablet'"),
        (online_regression, "dt=0.5", "window"),
        (online_regression, "rates=[nan]", "rates"),
        (online_regression, "rates=[5,5]", "rates"),
        (online_regression, "rates=[]", "rates"),
        (online_regression, "visit_length=1e12", "samples"),
        (online_regression, "visits=1", "visits"),
        (online_regression, "seed=99999999999999999999", "seed"),
        (online_regression, "run_dir=/proc/none", "/proc/none"),
        (online_regression, "member=20", "member"),
        (online_regression, "shift_threshold=-1", "shift_threshold"),
        (recall, "variants=[]", "at least one"),
        (recall, "n_pairs=9", "n_pairs"),
        (recall, "rate=0", "rate"),
        (recall, "n_keys=10000000000000", "n_keys"),
        (recall, "seeds=99999999999999999999", "seeds"),
        (recall, "iterations=49", "iterations"),
        (recall, "workers=0", "workers"),
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
    sizes = {v: n_parameters(build_model(cfg, v)) for v in RECALLERS}
    cells = {sizes[v] for v in ("soft", "hard", "reallocating", "relaxed")}
    assert len(cells) == 1
    assert all(abs(size / max(cells) - 1) < 0.08 for size in sizes.values()), sizes


def test_a_short_training_of_the_cell_beats_what_can_be_had_without_matching_keys() -> None:
    cfg = RecallConfig(n_keys=3, n_values=2, n_pairs=2, n_slots=3, iterations=120)
    found = recall.learn(cfg, "soft", 3)
    answer = sequences(cfg, 2000, torch.Generator().manual_seed(0))[1]
    assert found.accuracy > 0.95 > without_keys(answer)


def test_sizes_of_the_others_are_the_nearest_to_the_cells() -> None:
    for options in ({"n_slots": 300, "hidden_size": 4}, {"hidden_size": 1}, {}):
        cfg = RecallConfig(**options)
        target = n_parameters(build_model(cfg, "soft"))
        for variant, kind in (("lstm", nn.LSTM), ("gru", nn.GRU)):
            model = build_model(cfg, variant)
            size, width = model.rnn.hidden_size, model.rnn.input_size
            gap = abs(n_parameters(model) - target)
            for other in {max(1, size - 1), size + 1}:
                assert gap <= abs(n_parameters(Recurrent(kind, width, other, 8)) - target)


def test_a_function_comes_back_as_it_was_and_differs_from_the_others() -> None:
    cfg, generator = OnlineRegressionConfig(seeds=4), torch.Generator().manual_seed(0)
    stream = draw_stream(cfg, generator)
    for k in range(3):
        inputs, answers, basis = stream.samples(k, 50, generator)
        torch.testing.assert_close(stream.value(k, inputs[..., 0]), answers)
        torch.testing.assert_close(stream.value(k, inputs[..., 1]), inputs[..., 2])
        torch.testing.assert_close(basis[..., 2], inputs[..., 0] ** 2)
        other = stream.value((k + 1) % 3, inputs[..., 0])
        assert float((other - answers).abs().mean()) > 0.1


def test_measures_of_made_up_errors_are_what_was_put_in() -> None:
    cfg = OnlineRegressionConfig(n_functions=2, visit_length=4.0, dt=0.1, window=1.0, seeds=3)
    rms = torch.tensor([[2.0, 1.0, 1.0], [1.0, 1.0, 1.0]])
    error = torch.full((4, 40, 3), 0.9)  # visits f1 f2 f1 f2; f1 of seed 0 counts 0.9 as recovered
    error[2:, :10] = 5.0  # the second after a switch
    error[2:, 30:, 1] = 0.1  # seed 1 recovers after 3 s
    error[0] = 77.0  # a first visit is no return
    error[1, 7, 2] = torch.inf
    probed = torch.arange(8.0).reshape(4, 2, 1).expand(4, 2, 3)  # after visit v, on k: 2 v + k
    found = measured(cfg, error.square(), probed, rms)
    assert np.isnan([values[2] for values in found.values()]).all()
    np.testing.assert_allclose(found["after_switch"][:2], 5.0, rtol=1e-6)
    np.testing.assert_allclose(found["steady"][:2], [0.9, np.sqrt((0.81 + 0.01) / 2)], rtol=1e-6)
    np.testing.assert_allclose(found["recovered"][:2], [0.5, 1.0])
    np.testing.assert_allclose(found["recovery_s"][:2], [(1.0 + 4.0) / 2, 3.0])
    np.testing.assert_allclose(found["before_return"][:2], (2 * 1 + 0 + 2 * 2 + 1) / 2)
    np.testing.assert_allclose(found["at_leaving"][:2], (0 + 2 * 1 + 1) / 2)


def test_each_variant_takes_the_rate_that_is_best_on_other_streams() -> None:
    short = {"visit_length": 4.0, "visits": 2, "dt": 0.02, "seeds": 4, "seed": 3}
    cfg = OnlineRegressionConfig(rates=[0.01, 10.0, 1e5], **short)
    found = online_regression.learn(cfg, "network")
    assert found.rate == 10.0  # the first learns nothing, the last diverges
    one = online_regression.learn(OnlineRegressionConfig(rates=[10.0], **short), "network")
    np.testing.assert_array_equal(found.rmse, one.rmse)


def test_a_run_that_diverges_says_so() -> None:
    cfg = OnlineRegressionConfig(rates=[1e5], visit_length=2.0, visits=2, dt=0.02, seeds=2)
    wild = online_regression.learn(cfg, "network").measures
    fine = {name: np.ones(2) for name in wild}
    measure = Measure("after_switch", "after", 2)
    table = compare([measure], {"network": fine, "soft": wild}, {"soft": "network"}, {}).markdown
    assert "| soft | diverged (2 of 2 seeds) |" in table


def test_verdicts_are_paired() -> None:
    base = np.array([1.0, 2.0, 3.0, 4.0])
    assert verdict(base - [0.1, 0.11, 0.1, 0.09], base, lower_is_better=True) == "better"
    assert verdict(base - [-0.1, -0.11, -0.1, -0.09], base, lower_is_better=True) == "worse"
    assert verdict(base - [0.1, -0.1, 0.1, -0.1], base, lower_is_better=True) == "no difference"
    assert verdict(base[:1], base[:1], lower_is_better=True) == "too few seeds to tell"
    assert verdict(np.full(4, np.inf), base, lower_is_better=True) == "diverged"
