"""The tuner with a judge and limits of one's own."""

import io
import math

import pytest
import torch
from torch import Tensor

import mann_torch as mt
from mann_torch.tuning import (
    EVERYTHING,
    MODES,
    MOTION,
    TOTALS,
    Criterion,
    Ensemble,
    GradientSettings,
    Judged,
    Limit,
    Schedule,
    Tuner,
    constants_at,
)
from mann_torch.tuning.criterion import Measured
from tests.tuning.test_judges import (
    B,
    both_joints,
    coordinates_of,
    ensemble,
    last_weights,
    peak_error,
    time_above,
    whole,
)

PEAK = Judged(peak_error, MOTION)
ENGINES_QUICK = (pytest.param("torch", marks=pytest.mark.slow), "compiled")


def speed(run: mt.Motion) -> Tensor:
    return run.qd.abs().amax(dim=(0, -1))


def tuned(
    criterion: Criterion, engine: str = "torch", mode: str = "smoothed", **schedule: object
) -> Tuner:
    plan = Schedule(**{"iterations": 8, "rate": 0.15, **schedule})  # type: ignore[arg-type]
    made = ensemble(engine)
    return Tuner(made, coordinates_of(made), criterion, GradientSettings(mode=mode, pairs=2), plan)


def finished(run: Tuner) -> Tuner:
    while not run.done:
        run.step()
    return run


def on_whole_rollouts(made: Ensemble, run: Tuner | None = None) -> mt.Trajectory:
    """Everything kept, at the constants to start from or where a run ended."""
    constants = {} if run is None else run.values()
    with torch.no_grad(), constants_at(made.loop.controller, constants):
        return whole(made)


@pytest.mark.parametrize("engine", ENGINES_QUICK)
def test_a_tuner_lowers_the_peak_error_of_whole_rollouts(engine: str) -> None:
    run = finished(tuned(Criterion(PEAK), engine, "plain"))
    before, after = (on_whole_rollouts(run.ensemble, end) for end in (None, run))
    assert float(peak_error(after).mean()) < 0.9 * float(peak_error(before).mean())
    first, second = run.history[0], run.history[1]
    assert first["objective"] == 1.0
    # What it went by is what a whole rollout shows there.
    values = run.coordinates.values(torch.tensor(first["z"], dtype=torch.float64))
    with torch.no_grad(), constants_at(run.ensemble.loop.controller, values):
        ratio = peak_error(whole(run.ensemble)) / peak_error(before)
    assert second["objective"] == float(ratio.mean())


@pytest.mark.parametrize(
    "mode",
    [pytest.param(m, marks=pytest.mark.slow) if m in ("hybrid", "soft") else m for m in MODES],
)
def test_every_mode_minimises_a_judge_of_ones_own(mode: str) -> None:
    run = finished(tuned(Criterion(PEAK), mode=mode, iterations=3))
    assert run.history[-1]["objective"] < run.history[0]["objective"]


@pytest.mark.parametrize("engine", ENGINES_QUICK)
def test_limits_of_ones_own_are_kept(engine: str) -> None:
    """A larger Lambda lowers the peak error and moves faster."""
    bound = 0.69
    limits = {"speed": Limit(Judged(speed, MOTION), bound)}
    free = finished(tuned(Criterion(PEAK), engine, iterations=12))
    held = finished(tuned(Criterion(PEAK, limits, penalty=100.0), engine, iterations=12))
    start, fast, slow = (on_whole_rollouts(free.ensemble, end) for end in (None, free, held))
    assert float(speed(fast).max()) > 1.1 * bound > bound > float(speed(start).max())
    assert float(speed(slow).max()) <= bound
    assert float(peak_error(slow).mean()) < 0.8 * float(peak_error(start).mean())


@pytest.mark.parametrize("optimizer", ["adam", pytest.param("lbfgs", marks=pytest.mark.slow)])
def test_a_run_that_is_saved_and_loaded_ends_in_the_same_bits(optimizer: str) -> None:
    criterion = Criterion(time_above, {"speed": Limit(speed, 1.02, relative=True)}, scale=0.4)
    settings = {
        "optimizer": optimizer,
        "minibatch": 2,
        "curriculum": [(0, 0.3), (2, 0.4)],
        "iterations": 4,
    }
    all_of_it, part = finished(tuned(criterion, **settings)), tuned(criterion, **settings)
    part.step()
    part.step()
    file = io.BytesIO()
    torch.save(part.state_dict(), file)
    file.seek(0)
    again = tuned(criterion, **settings)
    again.load_state_dict(torch.load(file, weights_only=True))
    assert all_of_it.history == finished(again).history


def measured(value: float, *quantities: float) -> Measured:
    """Of one member."""
    numbers = torch.tensor([[value, *quantities]], dtype=torch.float64)
    return Measured(numbers[:, 0], numbers[:, 1:])


def test_a_criterion_counts_what_exceeds_a_limit() -> None:
    limits = {"a": Limit(speed, 2.0), "b": Limit(speed, 1.5, relative=True)}
    criterion, start = Criterion(PEAK, limits, penalty=10.0), measured(0.5, 1.0, 4.0)
    for at, expected in (
        (measured(0.4, 2.0, 6.0), 0.8),  # at its limits
        (measured(0.5, 2.2, 6.0), 1.0 + 10 * 0.01),
        (measured(0.5, 1.0, 7.2), 1.0 + 10 * 0.04),
        (measured(10.0, 1.0, 1.0), 10 * (1 + math.log(2.0))),
        (measured(math.nan, 1.0, 1.0), 50.0),
        (measured(0.1, math.inf, 1.0), 50.0),
    ):
        assert criterion(at, start).item() == pytest.approx(expected)
    assert Criterion(PEAK, scale=0.1)(measured(-0.2), measured(0.0)).item() == pytest.approx(-2.0)


def test_a_sample_that_diverged_is_flat_and_leaves_no_nan_in_a_gradient() -> None:
    made = ensemble(horizon=0.05)
    criterion = Criterion(PEAK, {"weights": Limit(last_weights, 1.0)})
    controller = made.loop.controller
    start = criterion.measure(made.run({}))
    gain = torch.tensor([10.0, 1e7, 10.0], dtype=torch.float64)
    with constants_at(controller, {"rate_W": gain}):
        free = controller.constant("rate_W").requires_grad_(True)
        run = mt.rollout(
            made.loop, made.scenario, made.solver, weights=made.weights, divergence_limit=1e4
        )
        assert run.status.tolist() == [0, 1, 0]
        found = criterion.measure(run)
        assert torch.isfinite(peak_error(run)).all() and found.value.isnan().tolist()[1]
        worth = criterion(found, start)
        (gradient,) = torch.autograd.grad(worth.sum(), free)
    assert worth[1].item() == 50.0
    assert gradient[1] == 0 and bool((gradient[[0, 2]] != 0).all())


def test_what_rollouts_keep_is_what_all_judges_declare() -> None:
    totals = Judged(both_joints, TOTALS)
    assert Criterion(totals).recording == TOTALS
    assert Criterion(totals, {"speed": Limit(Judged(speed, MOTION), 1.0)}).recording == MOTION
    assert Criterion(PEAK, {"speed": Limit(speed, 1.0)}).recording == EVERYTHING
    with pytest.raises(mt.RecordError, match="motion_dt"):
        tuned(Criterion(Judged(peak_error, TOTALS))).step()


def test_what_makes_no_sense_is_a_named_error() -> None:
    for bad in (0.0, -1.0, math.nan):
        with pytest.raises(mt.ConfigError, match="limit"):
            Limit(speed, bad)
        with pytest.raises(mt.ConfigError, match="scale"):
            Criterion(PEAK, scale=bad)
    with pytest.raises(mt.ConfigError, match="penalty"):
        Criterion(PEAK, penalty=-1.0)
    one, none = measured(1.0, 1.0), measured(0.0, 0.0)
    with pytest.raises(mt.ConfigError, match="give a scale"):
        Criterion(PEAK)(measured(1.0), measured(0.0))
    relative = Criterion(PEAK, {"late": Limit(speed, 1.0, relative=True)}, scale=1.0)
    with pytest.raises(mt.ConfigError, match="relative limit 'late'"):
        relative(one, none)
    with pytest.raises(mt.SolverError, match="is NaN, with the constants"):
        tuned(Criterion(lambda run: peak_error(run) * math.nan)).step()
    assert len(ensemble()) == B
