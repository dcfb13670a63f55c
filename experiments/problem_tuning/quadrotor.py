"""Problem 1: a quadrotor's gains and features, on random splines in random winds."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Sequence
from typing import cast

import torch
from torch import Tensor

from mann_torch import MeasurementNoise, PlantState, Scenario, Trajectory
from mann_torch.plants import Plant
from mann_torch.signals import Disturbance, Polynomial, Spline
from mann_torch.tuning import Ensemble, Judged, Recording
from mann_torch.types import ClockState

from ..building.build import Experiment, build
from ..building.ensembles import composed
from ..settings.problem_tuning_config import ProblemTuningConfig
from .tuned_problem import Members, TunedProblem, Way, beside, root_mean_square, uniform

#: The authors' references: knots, steps between them in x, y [m] and phi [rad], and phi's range.
KNOTS, STEPS, PITCH = 6, (2.0, 2.0, math.pi / 6), 0.7 * math.pi / 3
#: Beyond the horizon, as a share of it: a spline holds still at its last knot.
BEYOND = 0.2
#: Winds [m/s] to learn from are uniform up to the first; those of the test 10 times Beta(5, 7).
LEARNED, TESTED, SHAPE = 6.0, 10.0, (5, 7)
#: Samples of noise a second: one a tick.
RATE = 100.0
GAINS = ("error_gain", "feedback", "drive_gain")
FEATURES = ("layer_weight_1", "layer_bias_1", "layer_weight_2", "layer_bias_2")
KEPT = Recording(motion_dt=1e9, sample_dt=0.01)


def problem(cfg: ProblemTuningConfig) -> TunedProblem:
    """The authors' gains for problem 1 and their features, tuned gains, and both tuned."""
    made = build(composed(("problem=quadrotor_learned",)))
    plant = made.loop.plant
    learned = splines(plant, cfg.train, cfg.train_horizon, cfg.seed, light, cfg.noise)
    tested = splines(plant, cfg.held_out, 10.0, cfg.seed + 1_000_000, beta, cfg.noise)
    return TunedProblem(
        title="quadrotor in wind, random splines",
        unit="m, rad and their rates",
        ways={
            "authors": Way("Lambda = 1, K = P = 10, the authors' features"),
            "gains": Way("Lambda, K, P tuned, the authors' features", tuned=GAINS),
            "gains_and_features": Way("Lambda, K, P and all layers tuned", tuned=GAINS + FEATURES),
        },
        train=members(made, learned),
        held_out=members(made, tested),
    )


def members(made: Experiment, scenario: Scenario) -> Members:
    """The problem's loop in these scenarios."""
    ensemble = Ensemble(made.loop, scenario, None, made.solver, effort_after=None)

    def error(run: Trajectory) -> Tensor:
        """RMS of the six errors at the ticks."""
        state, wanted = run.states.plant, scenario.reference(run.sample_t)
        parts = [state.q - beside(wanted.value, state.q), state.qd - beside(wanted.rate, state.qd)]
        return root_mean_square(torch.cat(parts, dim=-1))

    return Members(ensemble, Judged(error, KEPT), Judged(_held_input, KEPT))


def _held_input(run: Trajectory) -> Tensor:
    """RMS of what the clock holds: a sample shows the command of the tick before it."""
    return root_mean_square(cast(ClockState, run.held.clock).input[1:])


def splines(
    plant: Plant,
    count: int,
    horizon: float,
    seed: int,
    winds: Callable[[int, torch.Generator], Tensor],
    noise: Sequence[float],
) -> Scenario:
    """Random walks from knot to knot, smooth to the fourth derivative; each starts on its own."""
    generator = torch.Generator().manual_seed(seed)
    end = horizon * (1.0 + BEYOND)
    times = torch.linspace(0.0, end, KNOTS + 1, dtype=torch.float64)
    rows = [torch.zeros(count, 3, dtype=torch.float64)]
    for _ in range(KNOTS):
        steps = [uniform(count, -step, step, generator) for step in STEPS]
        x, y, pitch = (rows[-1] + torch.stack(steps, dim=-1)).unbind(dim=-1)
        rows.append(torch.stack([x, y, pitch.clamp(-PITCH, PITCH)], dim=-1))
    reference = Spline(times.expand(count, -1), torch.stack(rows, dim=-2), degree=5)
    begin = reference(torch.zeros((), dtype=torch.float64))
    value, rate = begin.upto(1)
    wind = Disturbance(plant=Polynomial(winds(count, generator).reshape(count, 1, 1)))
    scenario = Scenario(reference, plant.parameters_of(), horizon, start=PlantState(value, rate))
    seen = None
    if any(noise):
        seeds = torch.arange(count) + (seed << 20)
        seen = MeasurementNoise(torch.tensor(noise).double().expand(count, -1), seeds, RATE)
    return dataclasses.replace(scenario, disturbance=wind, noise=seen)


def light(count: int, generator: torch.Generator) -> Tensor:
    """Winds to learn from."""
    return uniform(count, 0.0, LEARNED, generator)


def beta(count: int, generator: torch.Generator) -> Tensor:
    """Winds of the authors' test, 10 Beta(5, 7): the fifth smallest of 11 uniform numbers."""
    a, b = SHAPE
    drawn = torch.rand(count, a + b - 1, generator=generator, dtype=torch.float64)
    return TESTED * drawn.sort(dim=-1).values[:, a - 1]
