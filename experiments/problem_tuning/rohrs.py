"""Problem 2: what keeps Rohrs' loop bounded, tuned for error under a limit on the input."""

from __future__ import annotations

from collections.abc import Callable

import torch
from torch import Tensor

from mann_torch import ClosedLoop, Scenario, Sinusoid, Trajectory
from mann_torch.metrics import srmse
from mann_torch.simulation import observe
from mann_torch.tuning import Ensemble, Judged, Recording

from ..building.build import Experiment, build
from ..building.ensembles import composed
from ..settings.problem_tuning_config import ProblemTuningConfig
from .tuned_problem import Known, Members, TunedProblem, Way, root_mean_square, uniform

#: Of r = offset + amplitude sin(frequency t): about the published cases, crossing included.
AMPLITUDES, FREQUENCIES, OFFSETS = (1.0, 2.0), (4.0, 20.0), (0.1, 0.5)
HORIZON = 40.0  # [s] to be judged on
#: Where nothing pulls and nothing projects: sigma must be > 0 for coordinates.
FREE = 1e9
KEPT = Recording(motion_dt=1e9, sample_dt=0.02)


def problem(cfg: ProblemTuningConfig) -> TunedProblem:
    """The published modifications, and both together, tuned from where both act."""
    made = build(composed(("problem=rohrs_sigma", "law.projection.bound=10", "solver.dt=2e-3")))
    both: Known = {"sigma": [0.2, 0.2], "bound": 2.0}
    published: Known = {"sigma": [0.2, 0.0], "bound": FREE}
    return TunedProblem(
        title="Rohrs' plant, random sinusoids",
        unit="-",
        ways={
            "projection": Way("norm <= 10, as published", {"sigma": [0.0, 0.0], "bound": 10.0}),
            "sigma": Way("sigma 0.2 on k_y alone, as published", published),
            "both": Way("sigma 0.2 on both gains, norm <= 2", both),
            "tuned": Way("sigma and bound tuned from there", both, ("sigma", "bound")),
        },
        train=members(made, sinusoids(made, cfg.train, cfg.train_horizon * 4, cfg.seed)),
        held_out=members(made, sinusoids(made, cfg.held_out, HORIZON, cfg.seed + 1_000_000)),
    )


def members(made: Experiment, scenario: Scenario) -> Members:
    """The problem's loop under these references."""
    loop = made.loop
    ensemble = Ensemble(loop, scenario, None, made.solver, effort_after=None)
    return Members(ensemble, Judged(_error, KEPT), Judged(_input_of(loop, scenario), KEPT))


def _error(run: Trajectory) -> Tensor:
    """RMS of y_m - y."""
    found: Tensor = srmse(run)[..., 0]
    return found


def _input_of(loop: ClosedLoop, scenario: Scenario) -> Callable[[Trajectory], Tensor]:
    def effort(run: Trajectory) -> Tensor:
        """RMS of u."""
        return root_mean_square(observe(loop, scenario, run).input)

    return effort


def sinusoids(made: Experiment, count: int, horizon: float, seed: int) -> Scenario:
    """Random ones, each from rest."""
    generator = torch.Generator().manual_seed(seed)
    amplitude, frequency, offset = (
        uniform(count, *span, generator).unsqueeze(-1)
        for span in (AMPLITUDES, FREQUENCIES, OFFSETS)
    )
    signal = Sinusoid(amplitude, frequency, offset=offset)
    return Scenario(signal, made.loop.plant.parameters_of(), horizon)
