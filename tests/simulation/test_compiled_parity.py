"""The compiled engine computes what the torch engine computes."""

from __future__ import annotations

import dataclasses

import pytest
import torch
from omegaconf import OmegaConf

import mann_torch as mt
from experiments.building.build import Experiment, build
from experiments.command.cli import compose_job
from experiments.command.conf_files import group_names
from experiments.settings.config import SimulateConfig
from mann_torch.trees import leaves
from mann_torch.types import NetworkState
from tests.conftest import GOLDEN, randn
from tests.simulation.loops import NAMES, Case, case

ENGINES = ("torch", "compiled")


def relative(a: torch.Tensor, b: torch.Tensor) -> float:
    """Largest difference against the largest entry."""
    if a.numel() == 0:
        return 0.0
    return float(((a - b).abs().max() / a.abs().max().clamp(min=1e-300)).detach())


def assert_same(runs: list[mt.Trajectory], limit: float) -> None:
    """Motion, whole states, integral of squared error within `limit`; modes and status equal."""
    a, b = runs
    assert (a.engine, b.engine) == ("eager", "compiled")
    assert torch.equal(a.t, b.t) and torch.equal(a.sample_t, b.sample_t)
    pairs = [(a.q, b.q), (a.qd, b.qd), (a.squared_error, b.squared_error)]
    pairs += list(zip(leaves(a.states), leaves(b.states), strict=True))
    for mine, other in pairs:
        assert mine.shape == other.shape and relative(mine, other) <= limit
    for mode, other_mode in ((a.modes, b.modes), (a.final_mode, b.final_mode)):
        for mine, other in zip(leaves(mode), leaves(other_mode), strict=True):
            assert mine.dtype == other.dtype
            # Activity levels are numbers, all else are decisions.
            levels = mine.is_floating_point()
            assert relative(mine, other) <= limit if levels else torch.equal(mine, other)
    assert torch.equal(a.status, b.status)


def resets(name: str) -> bool:
    return "initial" in name or "always" in name


def both(made: Case | Experiment, *arguments: object, **options: object) -> list[mt.Trajectory]:
    with torch.no_grad():
        return [
            mt.rollout(
                made.loop,
                made.scenario,
                *arguments,
                weights=made.weights,
                engine=engine,
                **options,
            )
            for engine in ENGINES
        ]


#: Each is some seconds of compiling on a bare machine; the others come with `make check`.
QUICK = (
    ("nn", "scaled"),
    ("soft_state_keys", "scaled"),
    ("hard_state_keys", "scaled"),
    ("reallocating_always_state_keys", "scaled"),
    ("relaxed_always_state_keys", "scaled"),
)


@pytest.mark.parametrize(
    ("name", "reset"),
    [
        pair if pair in QUICK else pytest.param(*pair, marks=pytest.mark.slow)
        for pair in [(n, "scaled") for n in NAMES] + [(n, "raw") for n in NAMES if resets(n)]
    ],
)
def test_one_step_from_anywhere(name: str, reset: str) -> None:
    solver = mt.Implicit()
    assert_same(both(case(name, solver.dt, batch=20, reset=reset), solver), 1e-14)


@pytest.mark.parametrize(
    "name",
    [n if (n, "scaled") in QUICK else pytest.param(n, marks=pytest.mark.slow) for n in NAMES],
)
def test_a_hundred_steps_with_mass_jumps_friction_and_resets(name: str) -> None:
    solver = mt.Implicit(follow_reference=name != "soft")
    runs = both(case(name, 0.4), solver, sample_dt=0.02)
    assert_same(runs, 1e-13)
    if resets(name):
        assert (mt.reallocations(runs[0]) > 0).all()


def configured(*overrides: str, **changes: object) -> Experiment:
    cfg = OmegaConf.to_object(compose_job("simulate", list(overrides)))
    assert isinstance(cfg, SimulateConfig)
    return build(dataclasses.replace(cfg, **changes))


@pytest.mark.parametrize("scenario", group_names("scenario"))
@pytest.mark.parametrize("controller", ["nn", "reallocating_always"])
def test_one_step_of_every_scenario(controller: str, scenario: str) -> None:
    made = configured(f"controller={controller}", f"scenario='{scenario}'", horizon=4e-3)
    network = NetworkState(*(leaf + 0.2 * randn(*leaf.shape) for leaf in made.weights))
    assert_same(both(dataclasses.replace(made, weights=network)), 1e-14)


@pytest.mark.slow
@pytest.mark.parametrize("controller", ["nn", "soft"])
def test_twenty_seconds(controller: str) -> None:
    weights = f"initial.weights_file={GOLDEN / 'initial_weights.npz'}"
    made = configured(f"controller={controller}", weights, horizon=20.0)
    assert_same(both(made), 1e-9)


@pytest.mark.slow
@pytest.mark.parametrize("controller", ["nn", "soft"])
def test_330_s_of_a_smooth_controller(controller: str) -> None:
    runs = both(configured(f"controller={controller}"), motion_dt=0.05, sample_until=0.0)
    worst = float((mt.srmse(runs[1]) / mt.srmse(runs[0]) - 1).abs().max())
    print(f"{controller}, 330 s: SRMSE differs by {worst:.1e}")
    assert worst <= 1e-9


@pytest.mark.slow
@pytest.mark.parametrize("controller", ["hard", "reallocating_initial", "reallocating_always"])
def test_330_s_of_a_switching_controller(controller: str) -> None:
    made = configured(f"controller={controller}", draws=10)
    a, b = (mt.srmse(run) for run in both(made, motion_dt=0.05, sample_until=0.0))
    single = float((b / a - 1).abs().max())
    mean = float((b.mean(dim=0) / a.mean(dim=0) - 1).abs().max())
    print(f"{controller}, 330 s: single runs {100 * single:.2f} %, means {100 * mean:.2f} %")
    assert single <= 0.03 and mean <= 0.01


@pytest.mark.parametrize("name", ["nn", "reallocating_always_state_keys"])
def test_diverging_and_nan_samples_stop_alone_with_time_and_cause(name: str) -> None:
    made = case(name, 0.1, batch=4)
    W, b_v = made.weights.W.clone(), made.weights.b_v.clone()
    W[1] = 1e9  # feeds itself beyond every bound
    b_v[3] = 1e300  # its square overflows
    made = made._replace(weights=made.weights._replace(W=W, b_v=b_v))
    runs = both(made)
    for run in runs:
        assert run.status.tolist()[0] == run.status.tolist()[2] == 0
        assert run.status[1] != 0 and run.status[3] != 0
        assert torch.isfinite(run.stopped_at[[1, 3]]).all()
        assert torch.isfinite(run.q).all()
    a, b = runs
    assert a.describe_status() == b.describe_status()
    assert torch.equal(a.stopped_at.nan_to_num(-1.0), b.stopped_at.nan_to_num(-1.0))
    assert_same(runs, 1e-9)
    rows = torch.tensor([0, 2])
    start = made.scenario.start
    assert start is not None
    mates = Case(
        made.loop,
        dataclasses.replace(made.scenario, start=type(start)(*(leaf[rows] for leaf in start))),
        NetworkState(*(leaf[rows] for leaf in made.weights)),
    )
    torch.testing.assert_close(b.q[:, rows], both(mates)[1].q, rtol=0, atol=1e-12)


def test_where_every_sample_fails_both_engines_end_there() -> None:
    made = case("nn", 0.1, batch=2)
    made = made._replace(weights=made.weights._replace(W=torch.full_like(made.weights.W, 1e9)))
    a, b = both(made)
    assert len(a.t) == len(b.t) < len(a.step_t)
    assert torch.equal(a.t, b.t) and a.describe_status() == b.describe_status()
