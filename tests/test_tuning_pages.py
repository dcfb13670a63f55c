"""docs/tuning.md and docs/gradients.md do what they say: their code runs as printed."""

from __future__ import annotations

from typing import Any

import pytest
import torch

from tests.pages import executed, text_of


@pytest.fixture(scope="module")
def tuning() -> dict[str, Any]:
    return executed("tuning.md")


@pytest.fixture(scope="module")
def gradients() -> dict[str, Any]:
    return executed("gradients.md")


def test_the_objective_falls_within_its_limits(tuning: dict[str, Any]) -> None:
    objectives = tuning["objectives"]
    assert len(objectives) == 5 and objectives[-1] < 0.95 < objectives[0] < 1.1


def test_all_of_a_row_is_told(tuning: dict[str, Any]) -> None:
    page = text_of("tuning.md")
    assert tuning["tuner"].history
    assert all(f"`{name}`" in page for name in tuning["tuner"].history[0])


def test_a_judge_of_ones_own_is_lowered(tuning: dict[str, Any]) -> None:
    told = tuning["told"]
    assert len(told) == 10 and told[-1] < 0.8 < told[0]


def test_plain_and_hybrid_differ_where_attention_switches(gradients: dict[str, Any]) -> None:
    plain, hybrid = gradients["slopes"]["plain"], gradients["slopes"]["hybrid"]
    assert float(plain) != 0.0 and bool(torch.isfinite(hybrid))
    assert torch.allclose(plain, hybrid, rtol=0.2, atol=0.0)


def test_modes_agree_on_a_gain_and_differ_on_what_attention_compares(
    gradients: dict[str, Any],
) -> None:
    fd, smoothed, plain = (gradients["told"][mode] for mode in ("fd", "smoothed", "plain"))
    for slope in (smoothed, plain):
        room = slope.half[1] + fd.half[1]
        assert abs(float(slope.mean[1] - fd.mean[1])) < float(room)
    assert not bool(fd.silent.any())
