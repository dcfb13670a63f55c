"""The benchmark's lines, verdicts and page; its timings are no test's business."""

import importlib.util
from dataclasses import asdict
from typing import Any

import numpy as np
import pytest

from experiments.benchmark import SECTIONS, page, sections_of
from experiments.benchmarking import deploy as benchmark_deploy
from experiments.benchmarking import deploy_ticks
from experiments.benchmarking import events as benchmark_events
from experiments.benchmarking import lines as benchmark_lines
from experiments.benchmarking import parts as benchmark_parts
from experiments.benchmarking import start as benchmark_start
from experiments.benchmarking.curves import linearity
from experiments.benchmarking.lines import measured, table, verdicts
from experiments.benchmarking.measure import Section, Times, in_turns, ratio_of
from experiments.benchmarking.row import PAPER, Line, measure
from experiments.runs.workers import peak_mb


def columns(text: str) -> set[int]:
    return {line.count("|") for line in text.splitlines() if line.startswith("|")}


@pytest.mark.slow
@pytest.mark.parametrize(
    ("engine", "loop"),
    [("eager", "soft"), pytest.param("compiled", PAPER, marks=pytest.mark.slow)],
)
def test_a_line_reaches_the_same_figure_on_every_engine(engine: str, loop: str) -> None:
    result = measure(Line(engine, 2, 0.2, 0.1, 1, loop))
    other = measure(Line("compiled", 1, 0.2, 0.0, 1, loop))
    assert result["srmse"] == pytest.approx(other["srmse"], rel=1e-9)
    assert result["both_over_forward"] > 0 and result["peak_mb"] > 0


@pytest.mark.skipif(importlib.util.find_spec("jax") is None, reason="jax is not installed")
def test_the_peer_in_jax_computes_the_same() -> None:
    found, other = (measure(Line(e, 1, 0.2, 0.1)) for e in ("jax scan", "compiled"))
    assert found["srmse"] == pytest.approx(other["srmse"], rel=1e-9)


def made_up(engine: str, batch: int, **changes: object) -> dict:
    base = {"engine": engine, "batch": batch, "forward": 330.0, "gradient": 330.0, "loop": "soft"}
    base |= {"forward_s": 1e-3, "both_s": 5e-3, "both_over_forward": 4.0, "compile_s": 1.0}
    return base | {"peak_mb": 900.0, "srmse": [9e-3, 4e-3], "off": 0.1} | changes


def test_verdicts_follow_the_numbers() -> None:
    good = [made_up("compiled", 1), made_up("compiled", 64), made_up("dopri5", 1, forward_s=2.0)]
    good.append(made_up("torch.compile", 64, loop=PAPER, off=0.7, peak_mb=9e3))
    assert len(verdicts(good)) == 3 and all(held for _, _, held in verdicts(good))
    for line, change in (
        (1, {"peak_mb": 1100.0}),
        (1, {"off": 0.6}),
        (2, {"forward_s": 0.9}),
    ):
        bad = [dict(row) for row in good]
        bad[line].update(change)
        assert sum(not held for _, _, held in verdicts(bad)) == 1, change


def test_what_is_not_installed_is_a_line_that_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    monkeypatch.setattr(benchmark_lines, "LINES", (Line("jax scan", 1, 330.0, 10.0),))
    missing = measured(Line("jax scan", 1, 330.0, 10.0))
    lines = table([made_up("compiled", 1), made_up("eager", 8), missing])
    assert "not measured" in lines and "nan" not in lines and len(columns(lines)) == 1
    text = benchmark_lines.section(["jax scan"]).text
    assert "not measured, jax scan, B = 1: jax is not installed" in text


def test_engines_take_turns() -> None:
    order: list[str] = []
    sides = {name: (lambda name=name: order.append(name), 10) for name in "ab"}
    found = in_turns(sides, 3)
    assert "".join(order) == "abbaab" and all(len(t.each) == 3 for t in found.values())
    assert ratio_of(Times((4.0, 6.0, 50.0)), Times((2.0, 2.0, 1.0))) == (3.0, "3.00 (4.00)")
    assert 10 < peak_mb() < 1e5


@pytest.mark.slow
def test_what_events_cost_is_compared() -> None:
    case = benchmark_events.Case("1", 2, PAPER, horizon=0.2, rounds=1)
    result = benchmark_events.compare(case)
    assert len(result["events"]) == 3 and all(len(each) == 1 for each in result["us"].values())
    lines = benchmark_events.rows([result, {**result, "missing": "no kernel"}])
    assert {len(line) for line in lines} == {len(lines[0])} and len(lines) == 4


@pytest.mark.slow
@pytest.mark.parametrize("part", ["arm of 3 links", "KNearestAttention"])
def test_parts_of_ones_own_run_compiled(part: str) -> None:
    result = benchmark_parts.compare(benchmark_parts.Case(part, 2, 0.02, 0.2, rounds=1))
    assert result["apart"] < 1e-12 and result["gradient_apart"] < 1e-9
    lines = benchmark_parts.rows([{**result, "batch": 1}, {**result, "missing": "", "batch": 1}])
    assert {len(line) for line in lines} == {len(lines[0])} and len(lines) == 4


def test_the_first_rollout_is_timed(monkeypatch: pytest.MonkeyPatch) -> None:
    assert benchmark_start.first(1, False)["second"] > 0
    asked: list[Any] = []

    def process(module: str, given: object, **environment: str) -> dict[str, float]:
        asked.append((module, given, environment["WARP_CACHE_PATH"]))
        return {"first": 2.0}

    monkeypatch.setattr(benchmark_start, "in_process", process)
    result = benchmark_start.measure(1, True, rounds=2)
    assert [a[:2] for a in asked] == [("start", [1, True])] * 4
    assert asked[0][2] == asked[1][2] != asked[2][2]
    lines = benchmark_start.rows([result])
    assert lines[1][2:5] == ["2.00 s (2.00 s)", "6 s", "ok"] and lines[1][7] == "NOT MET"


def ticked(line: Any, **changes: object) -> dict[str, Any]:
    times = {"median": 1.5, "rare": 19.0, "rare_quiet": 3.0, "most": 900.0, "ticks": 1000}
    size = {"code": 15_000, "data": 0, "state": 3048} if line.engine in deploy_ticks.C else {}
    found = {**asdict(line), **times, **size, "bytes": {}, "input": [2.0, -4.0], "first_s": 1.0}
    return found | changes


def test_ticks_are_compared_and_judged() -> None:
    lines = benchmark_deploy.lines()
    results = [ticked(line) for line in lines]
    results[1] = ticked(lines[1], input=[2.0, -4.04], median=0.75)
    results[-1] = asdict(lines[-1]) | {"missing": "no g++ here"}
    rows = benchmark_deploy.rows(results)
    assert len(rows) == len(lines) + 1 and {len(row) for row in rows} == {9}
    assert rows[2][2:8] == ["float32", "0.75", "19 (3)", "900", "0.5 x", "1e-02"]
    text = benchmark_deploy.text_of(results)
    assert "NOT MET" not in text and "C, clang -O2" in text
    assert "not measured, AOTInductor, C++: no g++ here" in text
    slow = [ticked(line, median=2.5, rare=20.5) for line in lines]
    assert benchmark_deploy.text_of(slow).count("NOT MET") == 2 * len(deploy_ticks.C)


def test_the_quietest_tenth_is_that() -> None:
    took = np.ones(1000)
    took[:900] = 5.0
    found = deploy_ticks.times_of(took)
    assert (found["median"], found["rare_quiet"], found["most"]) == (5.0, 1.0, 5.0)


@pytest.mark.slow
@pytest.mark.parametrize("engine", ["C, gcc -O2", "AOTInductor, C++", *deploy_ticks.PYTHON])
def test_ticks_end_with_the_same_command_everywhere(engine: str) -> None:
    found, other = (
        deploy_ticks.measure(deploy_ticks.Line(name, PAPER), 400)
        for name in (engine, "compiled, Python")
    )
    assert found["input"] == pytest.approx(other["input"], rel=1e-12)
    assert 0.0 < found["median"] <= found["rare"] <= found["most"]


def test_cost_is_linear_where_it_is() -> None:
    share = np.outer([1.0, 8.0, 64.0, 512.0], [1.0, 2.0, 4.0, 8.0])
    assert all(held for _, _, held in linearity(share))
    assert not any(held for _, _, held in linearity(share**1.2))


def test_sections_not_measured_stay_and_say_how_they_were_made() -> None:
    first = page({name: Section(f"{name} 1", 0) for name in SECTIONS}, "", "Made by `a`: here.")
    assert first.count("Made by") == 1 and len(sections_of(first)) == len(SECTIONS)
    second = page({"parts": Section("parts 2", 0)}, first, "Made by `b`: there.")
    assert "parts 2" in second and "parts 1" not in second and "versus 1" in second
    assert second.count("Made by `a`: here.") == len(SECTIONS) - 1
    third = page({"start": Section("start 3", 0)}, second, "Made by `c`: there.")
    assert third.count("Made by `a`: here.") == len(SECTIONS) - 2
    assert third.count("Made by `b`: there.") == third.count("Made by `c`: there.") == 1
