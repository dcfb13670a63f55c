"""Golden numbers of an independent simulator (tests/golden, from its 1 ms runs)."""

from __future__ import annotations

import shutil
from typing import Any

import numpy as np
import pytest
from omegaconf import OmegaConf

from experiments.cli import compose_job
from experiments.golden import Check, checks, golden_file
from experiments.jobs import JobResult, run_job
from experiments.plan import Job
from experiments.results import Results
from tests.conftest import CONTROLLERS, GOLDEN


def golden_run(variant: str, scenarios: list[str], *overrides: str) -> tuple[Any, JobResult]:
    weights = f"initial.weights_file={GOLDEN / 'initial_weights.npz'}"
    cfg = OmegaConf.to_object(compose_job("reproduce", [weights, *overrides]))
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


def test_a_330_s_run_agrees_and_compiled_steps_equal_eager_ones() -> None:
    (check,) = golden_checks("soft", ["1"])
    assert check.passed and check.allowed == 1.5, check
    _, eager = golden_run("soft", ["1"], "horizon=0.2", "solver.compile=false")
    _, fused = golden_run("soft", ["1"], "horizon=0.2")
    np.testing.assert_allclose(fused.srmse, eager.srmse, rtol=1e-12)
    assert eager.engine == "eager"
    if shutil.which("g++"):
        assert fused.engine == "compiled"


@pytest.mark.parametrize("variant", CONTROLLERS)
def test_the_illustration_agrees_for_every_controller(variant: str) -> None:
    (check,) = golden_checks(variant, ["illustration"], "solver.compile=false")
    assert check.passed, check
    assert check.allowed == (3.0 if variant.startswith("reallocating") else 1.5)


@pytest.mark.slow
@pytest.mark.parametrize("variant", ["nn", "soft"])
def test_at_1_ms_smooth_controllers_agree_within_0_3_percent(variant: str) -> None:
    scenarios = sorted([*"123456", "illustration"])
    for check in golden_checks(variant, scenarios, "solver.dt=0.001"):
        assert check.passed and check.allowed == 0.3, check
