"""Online regression: a short run of all variants, what is refused, what is measured."""

import csv
import json
from pathlib import Path

import numpy as np
import pytest
import torch

from experiments import online_regression
from experiments.learning.online_learners import samples
from experiments.learning.online_measures import measured
from experiments.learning.report import Measure, compare, verdict
from experiments.sequence_tasks.streams import draw_stream
from experiments.settings.memory_config import LEARNERS, OnlineRegressionConfig
from tests.experiments.command import exit_code, logged

SHORT = ["visit_length=1", "visits=2", "window=0.5", "dt=0.05", "seeds=2", "workers=1"]
SHORT += ["rates=[1,2]"]


def test_a_short_run_writes_everything(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    folder = tmp_path / "run"
    assert (
        exit_code(monkeypatch, online_regression.main, *SHORT, "member=1", f"run_dir={folder}") == 0
    )
    with open(folder / "table.csv") as file:
        rows = list(csv.DictReader(file))
    assert {row["variant"] for row in rows} == set(LEARNERS)
    metrics = json.loads((folder / "metrics.json").read_text())
    assert len(metrics["table"]) == len(LEARNERS)
    assert metrics["command"] in (folder / "report.md").read_text()
    assert (folder / "memory.png").exists() and (folder / "config.yaml").exists()
    with np.load(folder / "arrays.npz") as arrays:
        assert arrays["soft/steady"].shape == (2,)
        for variant in ("soft", "hard"):
            weights = arrays[f"{variant}/weights"]
            np.testing.assert_allclose(weights.sum(-1), 1.0, atol=1e-12)
            assert arrays[f"{variant}/mu"].shape[:2] == weights.shape
            assert len(arrays[f"{variant}/reallocation_step"]) == 0
    log = logged(folder)
    assert "memory" in log.Tags()["images"]
    assert {f"{v}/" for v in LEARNERS} == {
        tag.split("/")[0] + "/" for tag in log.Tags()["scalars"] if tag.count("/") == 1
    }
    assert exit_code(monkeypatch, online_regression.main, *SHORT, f"run_dir={folder}") == 2


@pytest.mark.parametrize(
    ("bad", "said"),
    [
        ("variants=[tablet]", "unknown variant 'tablet'"),
        ("dt=0.5", "window"),
        ("rates=[nan]", "rates"),
        ("rates=[5,5]", "rates"),
        ("rates=[]", "rates"),
        ("visit_length=1e12", "samples"),
        ("visits=1", "visits"),
        ("seed=99999999999999999999", "seed"),
        ("run_dir=/proc/none", "/proc/none"),
        ("member=20", "member"),
        ("shift_threshold=-1", "shift_threshold"),
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
    assert exit_code(monkeypatch, online_regression.main, bad) == 2
    message = capfd.readouterr().err
    assert said in message and len(message.strip().splitlines()) == 1
    assert not list(tmp_path.iterdir())


def test_a_function_comes_back_as_it_was_and_differs_from_the_others() -> None:
    generator = torch.Generator().manual_seed(0)
    stream = draw_stream(4, 3, generator)
    for k in range(3):
        inputs, answers = samples(stream, k, 50, generator)
        torch.testing.assert_close(stream.value(k, inputs[..., 0]), answers)
        torch.testing.assert_close(stream.value(k, inputs[..., 1]), inputs[..., 2])
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
