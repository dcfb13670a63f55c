"""The benchmark's lines, verdicts and page; its timings are no test's business."""

import importlib.util

import pytest

from experiments.benchmark import _measured, _table, verdicts
from experiments.benchmark_row import Line, measure


@pytest.mark.parametrize("engine", ["fused", "eager"])
def test_a_line_reaches_the_same_figure_on_both_engines(engine: str) -> None:
    result = measure(Line(engine, 2, 0.2, 0.1))
    assert result["srmse"] == pytest.approx(measure(Line("fused", 1, 0.2, 0.0))["srmse"], rel=1e-9)
    assert result["both_over_forward"] > 1 and result["peak_mb"] > 0


@pytest.mark.skipif(importlib.util.find_spec("jax") is None, reason="jax is not installed")
def test_the_peer_in_jax_computes_the_same() -> None:
    found = measure(Line("jax scan", 1, 0.2, 0.1))
    assert found["srmse"] == pytest.approx(measure(Line("fused", 1, 0.2, 0.0))["srmse"], rel=1e-9)


def made_up(engine: str, batch: int, **changes: object) -> dict:
    base = {"engine": engine, "batch": batch, "forward": 330.0, "gradient": 330.0}
    base |= {"forward_s": 1e-3, "both_s": 5e-3, "both_over_forward": 5.0, "compile_s": 1.0}
    return base | {"peak_mb": 900.0, "srmse": [9e-3, 4e-3], "off": 0.1} | changes


def test_verdicts_follow_the_numbers() -> None:
    good = [made_up("fused", 1), made_up("fused", 64), made_up("dopri5", 1, forward_s=2.0)]
    assert len(verdicts(good)) == 5 and all(held for _, _, held in verdicts(good))
    for line, change in (
        (0, {"both_over_forward": 8.5}),
        (1, {"peak_mb": 2100.0}),
        (1, {"off": 0.6}),
        (2, {"forward_s": 0.9}),
    ):
        bad = [dict(row) for row in good]
        bad[line].update(change)
        assert sum(not held for _, _, held in verdicts(bad)) == 1, change


def test_what_is_not_installed_is_a_line_that_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    rows = [made_up("fused", 1), _measured(Line("jax scan", 1, 330.0, 10.0))]
    table = _table(rows)
    assert "jax is not installed" in table and len(table.splitlines()) == 4
    assert len({line.count("|") for line in table.splitlines()}) == 1
