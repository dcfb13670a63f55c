"""The tuner on short rollouts of the real loop."""

import dataclasses
import io
import math

import pytest
import torch

import mann_torch as mt
from mann_torch.tuning import (
    MODES,
    OPTIMIZERS,
    Coordinates,
    Ensemble,
    GradientSettings,
    Objective,
    Schedule,
    Score,
    Tuner,
    constants_at,
    pathwise_slopes,
    slope_of,
)
from tests.conftest import generator, make_loop, make_scenario

B = 4
NAMES = ["error_gain", "rate_W", "write_gain"]


def ensemble(name: str = "hard", horizon: float = 0.08) -> Ensemble:
    loop = make_loop(name)
    one = make_scenario(horizon, jumps=(0.5 * horizon,))
    noise = mt.MeasurementNoise([1e-4, 1e-3])
    scenario = mt.Scenario.stack(
        [
            mt.Scenario(one.reference, one.parameters, horizon, one.schedule, noise=noise)
            for _ in range(B)
        ]
    )
    network = loop.controller.initial_weights((B,), generator(3))
    # The torch engine has nothing to compile; the compiled engine's effort has tests of its own.
    return Ensemble(loop, scenario, network, mt.Implicit(), effort_after=0.02, engine="torch")


def tuner(mode: str = "smoothed", horizon: float = 0.08, **schedule: object) -> Tuner:
    made = ensemble(horizon=horizon)
    plan = Schedule(**{"iterations": 4, **schedule})  # type: ignore[arg-type]
    coordinates = Coordinates(made.loop.controller, NAMES)
    settings = GradientSettings(mode=mode, pairs=2)
    return Tuner(made, coordinates, Objective(0.1, None, None), settings, plan)


def finished(run: Tuner) -> Tuner:
    while not run.done:
        run.step()
    return run


def test_peaks_that_no_member_would_show_are_refused() -> None:
    run = tuner()
    late = dataclasses.replace(run.ensemble, effort_after=5.0)
    with pytest.raises(mt.ConfigError, match="effort_after = 5 s: peaks count from there on"):
        dataclasses.replace(run, ensemble=late, objective=Objective())
    dataclasses.replace(run, ensemble=late, objective=Objective(peak_limit=None))


@pytest.mark.parametrize("mode", MODES)
def test_every_mode_goes_downhill(mode: str) -> None:
    run = finished(tuner(mode, iterations=5))
    first, last = run.history[0]["objective"], run.history[-1]["objective"]
    assert last < first
    assert run.values()["error_gain"][0, 0] > 5.0  # a larger Lambda is where it goes
    found = run.signal()
    assert found.mean.shape == found.half.shape == (3,) and found.mean[0] < 0


def test_a_restart_begins_elsewhere_and_is_judged_by_the_same_start() -> None:
    run = tuner("plain", iterations=3)
    begin = torch.tensor([0.2, -0.1, 0.3], dtype=torch.float64)
    other = dataclasses.replace(run, begin=begin)
    assert torch.equal(other.z, begin)
    values = {k: v.expand(1, *v.shape) for k, v in run.coordinates.values(begin).items()}
    start, there = run.ensemble.scores({}), run.ensemble.scores(values)
    first = other.step()["objective"]
    assert first == pytest.approx(float(other.objective(there, start).mean()))
    for bad in (torch.zeros(2), torch.tensor([0.0, 0.0, math.nan])):
        with pytest.raises(mt.ConfigError, match="3 finite coordinates"):
            dataclasses.replace(run, begin=bad)


@pytest.mark.parametrize("optimizer", OPTIMIZERS)
def test_every_optimizer_improves_on_the_start(optimizer: str) -> None:
    if optimizer == "optuna":
        pytest.importorskip("optuna")
    run = finished(tuner(horizon=0.2, optimizer=optimizer))
    start = run.ensemble.scores({})
    found = run.ensemble.scores({k: v.expand(1, *v.shape) for k, v in run.values().items()})
    before, after = (float(run.objective(s, start).mean()) for s in (start, found))
    assert before == pytest.approx(1.1) and after < before


@pytest.mark.parametrize("optimizer", OPTIMIZERS)
def test_a_run_that_is_saved_and_loaded_ends_in_the_same_bits(optimizer: str) -> None:
    if optimizer == "optuna":
        pytest.importorskip("optuna")
    settings = {"optimizer": optimizer, "minibatch": 3, "curriculum": [(0, 0.04), (2, 0.08)]}
    whole = finished(tuner(**settings))
    assert [row["horizon"] for row in whole.history] == [0.04, 0.04, 0.08, 0.08]
    part = tuner(**settings)
    part.step()
    part.step()
    file = io.BytesIO()
    torch.save(part.state_dict(), file)
    file.seek(0)
    again = tuner(**settings)
    again.load_state_dict(torch.load(file, weights_only=True))
    finished(again)
    for name, value in whole.values().items():
        assert torch.equal(value, again.values()[name])
    assert whole.history == again.history


def test_tuning_leaves_the_controller_as_it_was() -> None:
    run = tuner("plain")
    before = dict(run.ensemble.loop.controller.constants())
    run.step()
    after = run.ensemble.loop.controller.constants()
    assert all(after[name] is p and not p.requires_grad for name, p in before.items())


def test_constants_are_put_back_after_an_error() -> None:
    controller = make_loop("hard").controller
    before = controller.constant("rate_W")
    with (
        pytest.raises(mt.ConfigError),
        constants_at(controller, {"rate_W": torch.tensor(3.0).double()}),
    ):
        assert float(controller.constant("rate_W").detach()) == 3.0
        raise mt.ConfigError("on purpose")
    assert controller.constant("rate_W") is before


def test_members_slopes_are_their_own_and_agree_with_small_differences() -> None:
    made = ensemble("soft")
    coordinates = Coordinates(made.loop.controller, NAMES)
    start = made.scores({})

    def judge(trajectory: mt.Trajectory) -> torch.Tensor:
        return mt.srmse(trajectory).sum(dim=-1) / start.srmse

    zero = torch.zeros(3, dtype=torch.float64)
    exact, value = pathwise_slopes(made, coordinates, zero, judge, "plain")
    near = slope_of(made, coordinates, zero, judge, GradientSettings(mode="fd", step=1e-4))
    assert near.members is not None
    assert torch.allclose(exact, near.members, rtol=1e-5, atol=1e-8)
    assert exact.std(dim=0).min() > 0 and value == pytest.approx(near.value, rel=1e-6)


def test_the_threshold_is_reported_as_silent() -> None:
    made = ensemble("reallocating_initial")
    coordinates = Coordinates(made.loop.controller, ["error_gain", "shift_threshold"])
    run = Tuner(
        made,
        coordinates,
        Objective(0.0, None, None),
        GradientSettings(mode="plain"),
        Schedule(iterations=2),
    )
    finished(run)
    found = run.signal()
    assert found.mean[1] == 0 and found.half[1] == 0 and found.mean[0].abs() > found.half[0]
    assert run.silent() == ["shift_threshold"]


def test_the_objective_counts_what_exceeds_a_limit_and_is_flat_where_a_sample_diverged() -> None:
    one = torch.ones(1, dtype=torch.float64)
    start = Score(one, one, one)
    plain = Objective(effort_weight=0.5, rate_limit=None, peak_limit=None)
    assert plain(Score(0.8 * one, 0.6 * one, one), start).item() == pytest.approx(0.8 + 0.3)
    limited = Objective(0.0, 1.0, 1.0, saturation=2.0, penalty=10.0)
    assert limited(Score(one, 1.2 * one, one), start).item() == pytest.approx(1 + 10 * 0.04)
    saturated = limited(Score(one, one, 2.2 * one), start).item()
    assert saturated == pytest.approx(10 * (1 + math.log((1 + 10 * (1.44 + 0.01)) / 10)))
    lost = Score(*(torch.full((1,), math.nan, dtype=torch.float64, requires_grad=True),) * 3)
    value = limited(lost, start)
    assert value.item() == 50.0 > limited(Score(3 * one, 3 * one, 3 * one), start).item()
    value.sum().backward()
    assert lost.srmse.grad is not None and not bool(torch.isnan(lost.srmse.grad).any())


@pytest.mark.parametrize(
    "settings",
    [
        {"iterations": 0},
        {"optimizer": "sgd"},
        {"rate": float("nan")},
        {"minibatch": 1},
        {"curriculum": [(3, 1.0), (1, 2.0)]},
        {"curriculum": [(0, -1.0)]},
    ],
)
def test_a_schedule_that_makes_no_sense_is_a_named_error(settings: dict[str, object]) -> None:
    with pytest.raises(mt.ConfigError):
        Schedule(**settings)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    "settings",
    [
        {"mode": "magic"},
        {"spread": 0.0},
        {"pairs": 0},
        {"control": ["base_gain"]},
        {"temperature": -1.0},
        {"design": "neither"},
    ],
)
def test_gradient_settings_that_cannot_work_are_named_errors(settings: dict[str, object]) -> None:
    made = ensemble()
    with pytest.raises(mt.ConfigError):
        GradientSettings(**settings).check(B, Coordinates(made.loop.controller, NAMES))  # type: ignore[arg-type]
