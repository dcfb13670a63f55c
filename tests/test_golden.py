"""Golden numbers of an independent simulator (tests/golden, from its 1 ms runs)."""

from __future__ import annotations

import shutil
from typing import Any

import numpy as np
import pytest
from omegaconf import OmegaConf

from experiments.command.cli import compose_job
from experiments.reproduction.golden import Check, checks, golden_file
from experiments.reproduction.jobs import JobResult, run_job
from experiments.reproduction.plan import Job
from experiments.reproduction.results import Results
from tests.conftest import CONTROLLERS, GOLDEN


def config(*overrides: str) -> Any:
    weights = f"initial.weights_file={GOLDEN / 'initial_weights.npz'}"
    return OmegaConf.to_object(compose_job("reproduce", [weights, *overrides]))


def golden_run(variant: str, scenarios: list[str], *overrides: str) -> tuple[Any, JobResult]:
    cfg = config(*overrides)
    job = Job(variant, cfg.variants[variant], scenarios)
    result = run_job(cfg, job, lambda _: None)
    assert all(status == "ok" for row in result.status for status in row)
    return cfg, result


def golden_checks(variant: str, scenarios: list[str], *overrides: str) -> list[Check]:
    cfg, result = golden_run(variant, scenarios, *overrides)
    golden = golden_file(cfg)
    assert golden is not None
    found = checks(golden, Results([result]), cfg)
    assert [check.scenario for check in found] == scenarios
    return found


#: Each compiles a kernel on a bare machine; `make check` has them all.
QUICK = ("nn", "soft", "hard", "reallocating_always")


@pytest.mark.parametrize(
    "variant",
    [v if v in QUICK else pytest.param(v, marks=pytest.mark.slow) for v in CONTROLLERS],
)
def test_every_golden_run_agrees_at_the_default_step(variant: str) -> None:
    golden = golden_file(config())
    assert golden is not None
    scenarios = sorted(scenario for scenario, v in golden.runs if v == variant)
    assert "illustration" in scenarios
    for check in golden_checks(variant, scenarios):
        assert check.passed, check
        assert check.allowed == (3.0 if variant.startswith("reallocating") else 1.5)


@pytest.mark.slow
@pytest.mark.parametrize("variant", ["nn", "soft"])
def test_at_1_ms_smooth_controllers_agree_within_0_3_percent(variant: str) -> None:
    scenarios = sorted([*"123456", "illustration"])
    for check in golden_checks(variant, scenarios, "solver.dt=0.001"):
        assert check.passed and check.allowed == 0.3, check


@pytest.mark.slow
def test_compiled_steps_of_the_torch_engine_equal_eager_ones() -> None:
    torch_engine = ("horizon=0.2", "solver.engine=torch")
    _, eager = golden_run("soft", ["1"], *torch_engine, "solver.compile=false")
    _, compiled = golden_run("soft", ["1"], *torch_engine)
    np.testing.assert_allclose(compiled.srmse, eager.srmse, rtol=1e-12)
    assert eager.engine == "eager"
    if shutil.which("g++"):
        assert compiled.engine == "torch.compile"
