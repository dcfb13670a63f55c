"""Judges of one's own see what a whole rollout shows; what was not kept is refused."""

import dataclasses
from collections.abc import Callable

import pytest
import torch
from torch import Tensor

import mann_torch as mt
from mann_torch.tuning import (
    EVERYTHING,
    MOTION,
    TOTALS,
    Coordinates,
    Ensemble,
    GradientSettings,
    Judge,
    Judged,
    Objective,
    Recording,
    constants_at,
    differences,
    pathwise_slopes,
    slope_of,
    smoothed,
)
from mann_torch.tuning import ensemble as ensemble_file
from mann_torch.tuning.judges import recording_of
from tests.conftest import generator, make_loop

ENGINES = ("torch", "compiled")
B = 3
NAMES = ["error_gain", "rate_W"]
ZERO = torch.zeros(2, dtype=torch.float64)
HORIZON = 0.6


def peak_error(run: mt.Motion) -> Tensor:
    return run.error.abs().amax(dim=(0, -1))


def time_above(run: mt.Motion) -> Tensor:
    above = run.error.abs().amax(dim=-1)[:-1] > 0.1
    return torch.einsum("t,t...->...", run.t.diff(), above.double())


def last_weights(run: mt.Trajectory) -> Tensor:
    return run.states.controller.network.W[-1].square().sum(dim=(-2, -1))


def both_joints(run: mt.Outcome) -> Tensor:
    return mt.srmse(run).square().sum(dim=-1).sqrt()


JUDGES: dict[str, Judge] = {
    "peak": peak_error,
    "time": time_above,
    "weights": last_weights,
    "peak, declared": Judged(peak_error, MOTION),
    "totals": Judged(both_joints, TOTALS),
}


def ensemble(engine: str = "torch", horizon: float | list[float] = HORIZON) -> Ensemble:
    """Members that start without error: it is largest on the way, and smaller at the end."""
    loop = make_loop("hard")
    arm = mt.arm_parameters([0.8, 2.3])
    one = mt.Scenario(mt.Sinusoid([0.3, 0.2], [1.5, 1.0]), arm, 1.0)
    scenario = dataclasses.replace(mt.Scenario.stack([one] * B), horizon=horizon)
    network = loop.controller.initial_weights((B,), generator(3))
    return Ensemble(loop, scenario, network, mt.Implicit(), effort_after=None, engine=engine)


def coordinates_of(made: Ensemble) -> Coordinates:
    return Coordinates(made.loop.controller, NAMES)


def whole(made: Ensemble, **options: object) -> mt.Trajectory:
    """Everything kept, by `rollout` itself."""
    options = {"weights": made.weights, "engine": made.engine, **options}
    return mt.rollout(made.loop, made.scenario, made.solver, **options)  # type: ignore[arg-type]


def on_whole_rollouts(made: Ensemble, judge: Judge) -> Callable[[Tensor], Tensor]:
    """The objective at z (C, B, P), without the ensemble."""

    def values(z: Tensor) -> Tensor:
        constants = coordinates_of(made).values(z)
        with torch.no_grad(), constants_at(made.loop.controller, constants):
            return judge(whole(made))

    return values


@pytest.mark.parametrize("name", JUDGES)
@pytest.mark.parametrize("engine", ENGINES)
def test_a_judge_gives_what_it_gives_of_a_whole_rollout(engine: str, name: str) -> None:
    made, judge = ensemble(engine), JUDGES[name]
    values = on_whole_rollouts(made, judge)
    z = 0.3 * torch.tensor([[[1.0, 0.0]], [[0.0, -1.0]]], dtype=torch.float64)
    found = made.judged(coordinates_of(made).values(z), judge)
    assert found.shape == (2, B) and torch.equal(found, values(z.expand(2, B, 2)))


@pytest.mark.parametrize("judge", [peak_error, time_above], ids=["peak", "time"])
@pytest.mark.parametrize("engine", ENGINES)
def test_differences_and_smoothed_slopes_are_those_of_whole_rollouts(
    engine: str, judge: Judge
) -> None:
    made = ensemble(engine)
    values = on_whole_rollouts(made, judge)
    at = (made, coordinates_of(made), ZERO, judge)
    by_fd = slope_of(*at, GradientSettings(mode="fd", step=0.1))
    expected = differences(values, ZERO, B, 0.1)
    assert torch.equal(by_fd.mean, expected.mean) and by_fd.value == expected.value
    assert by_fd.mean[0] < 0  # a larger Lambda, a smaller and a shorter peak
    settings = GradientSettings(pairs=2, control=["rate_W"] if judge is peak_error else [])
    found = slope_of(*at, settings, generator(5))
    control = None
    if settings.control:
        exact, _ = pathwise_slopes(*at, "plain")
        control = torch.stack([torch.full((B,), torch.nan), exact[:, 1]], dim=-1)
    again = smoothed(
        values, ZERO, B, pairs=2, design="joint", generator=generator(5), control=control
    )
    assert torch.equal(found.mean, again.mean) and found.value == again.value


@pytest.mark.parametrize("name", ["peak", "weights", "peak, declared"])
@pytest.mark.parametrize("engine", ENGINES)
def test_plain_gradients_are_those_of_whole_rollouts(engine: str, name: str) -> None:
    made, judge = ensemble(engine), JUDGES[name]
    controller = made.loop.controller
    constants = coordinates_of(made).values(ZERO.expand(B, 2))
    value, found = made.pathwise(constants, judge)
    with constants_at(controller, constants):
        free = [controller.constant(name).requires_grad_(True) for name in NAMES]
        expected = judge(whole(made))
        gradients = torch.autograd.grad(expected.sum(), free)
    assert torch.equal(value, expected.detach())
    for name, gradient in zip(NAMES, gradients, strict=True):
        assert torch.equal(found[name], gradient) and bool((gradient != 0).any())
    at = (made, coordinates_of(made), ZERO, judge)
    slopes, near = (slope_of(*at, GradientSettings(m, step=1e-4)) for m in ("plain", "fd"))
    assert torch.allclose(slopes.mean, near.mean, rtol=1e-4, atol=1e-8)


@pytest.mark.parametrize("engine", ENGINES)
def test_what_a_judge_left_out_is_refused_and_said(engine: str) -> None:
    made = ensemble(engine)
    for judge, kept, word in (
        (peak_error, TOTALS, "'error'.*motion_dt"),
        (lambda run: run.q[-1, ..., 0], TOTALS, "'q'.*motion_dt"),
        (last_weights, TOTALS, "'states'.*sample_until"),
        (last_weights, MOTION, "'states'.*sample_until"),
        (lambda run: mt.srmse(run, after=0.3).sum(-1), TOTALS, "motion_dt"),
    ):
        with pytest.raises(mt.RecordError, match=word):
            made.judged({}, Judged(judge, kept))
        with pytest.raises(mt.RecordError, match=word):
            made.pathwise({}, Judged(judge, kept))
        made.judged({}, judge)
    with pytest.raises(AttributeError, match="no attribute 'torque'"):
        made.judged({}, Judged(lambda run: run.torque, TOTALS))


@pytest.mark.parametrize("engine", ENGINES)
def test_two_instants_are_no_course_of_an_error(engine: str) -> None:
    made = ensemble(engine)
    full = whole(made)
    thin = whole(made, motion_dt=made.scenario.end)
    assert full.complete and not thin.complete and len(thin.t) == 2
    for name in ("error", "reference"):
        with pytest.raises(mt.RecordError, match=r"2 of 151 instants.*motion_dt"):
            getattr(thin, name)
    assert torch.equal(thin.q[-1], full.q[-1])  # what the motion came to is there
    assert torch.equal(mt.srmse(thin), mt.srmse(full))
    at_100_hz = whole(made, motion_dt=0.01)
    rows = torch.searchsorted(full.t, at_100_hz.t)
    assert not at_100_hz.complete and torch.equal(at_100_hz.error, full.error[rows])


def test_an_outcome_has_all_that_metrics_read() -> None:
    made = dataclasses.replace(ensemble(), effort_after=0.1)
    with torch.no_grad():
        full, outcome = made.run({}), made.run({}, recording=TOTALS)
        motion = made.run({}, recording=Recording(motion_dt=0.3, sample_until=0.0))
    assert type(full) is mt.Trajectory and type(outcome) is mt.Outcome
    for metric in (mt.srmse, mt.input_rate, mt.peak_input, mt.reallocations, mt.switches):
        for run in (outcome, motion, full.outcome, full.motion):
            assert torch.equal(metric(run), metric(full))
    assert outcome.describe_status() == ["ok"] * B and "Outcome(" in repr(outcome)
    assert torch.allclose(mt.srmse(motion, after=0.3), mt.srmse(full, after=0.3), rtol=1e-12)


def test_the_library_keeps_totals_alone_and_runs_keep_everything(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    kept = []

    def watched(*arguments: object, **options: object) -> mt.Trajectory:
        run = mt.rollout(*arguments, **options)  # type: ignore[arg-type]
        kept.append((len(run.t), len(run.sample_t)))
        return run

    monkeypatch.setattr(ensemble_file, "rollout", watched)
    made = dataclasses.replace(ensemble(), effort_after=0.1)
    made.scores({})
    made.judged({}, Judged(both_joints, TOTALS))
    made.judged({}, Judged(peak_error, MOTION))
    made.judged({}, peak_error)
    made.run({})
    assert kept == [(2, 1), (2, 1), (151, 1), (151, 13), (151, 13)]
    assert Objective().recording is TOTALS


def test_what_counts_ends_at_each_members_horizon() -> None:
    """A member's error counts up to its own horizon, even where it is rolled out further."""
    mixed, short = ensemble(horizon=[0.1, HORIZON, 0.1]), ensemble(horizon=0.1)

    def peak_within(run: mt.Motion) -> Tensor:
        return torch.where(run.within.unsqueeze(-1), run.error.abs(), 0.0).amax(dim=(0, -1))

    found, alone = mixed.judged({}, peak_within), short.judged({}, peak_error)
    assert torch.allclose(found[[0, 2]], alone[[0, 2]], rtol=1e-9) and found[1] > alone[1]


def test_judges_together_get_what_each_of_them_asks_for() -> None:
    def recorded(*asked: Recording) -> Recording:
        return recording_of(*(Judged(peak_error, recording) for recording in asked))

    coarse, fine = Recording(0.1, 0.05, 1.0), Recording(0.1, 0.01, 2.0)
    assert recording_of(peak_error) == recorded(TOTALS, EVERYTHING) == EVERYTHING
    assert recorded(TOTALS, TOTALS) == TOTALS and recorded(TOTALS, coarse) == coarse
    assert recorded(coarse, fine) == Recording(0.1, 0.01, 2.0)
    assert recorded(coarse, MOTION) == Recording(None, 0.05, 1.0)
    assert recorded(MOTION, EVERYTHING) == EVERYTHING
    with pytest.raises(mt.ConfigError, match="totals_only"):
        Recording(motion_dt=0.1, totals_only=True)


@pytest.mark.parametrize(
    "judge",
    [
        lambda run: run.error.abs().amax(dim=0),  # a number a joint
        lambda run: peak_error(run).mean(),  # one for all
        lambda run: 0.5,
    ],
)
def test_a_judge_gives_one_number_a_rollout(judge: Judge) -> None:
    with pytest.raises(mt.ShapeError, match="one number a rollout"):
        ensemble(horizon=0.05).judged({}, judge)
    counted = ensemble(horizon=0.05).judged({}, mt.switches)  # whole numbers are numbers
    assert counted.dtype == torch.float64
