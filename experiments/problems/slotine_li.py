"""Problem 3: two links, four unknown parameters."""

from __future__ import annotations

import math
from typing import cast

import numpy as np

from mann_torch.plants import MechanicalPlant

from .known import Case, Problem, at_most, closed, printed
from .measures import largest, mark, simpson
from .run import Run

DEGREES = 180.0 / math.pi
ERROR_GAIN, FEEDBACK = 20.0, 100.0


def _filtered(run: Run, q: np.ndarray, qd: np.ndarray, t: np.ndarray) -> np.ndarray:
    value, rate = run.wanted(t)
    return np.asarray(rate - qd + ERROR_GAIN * (value - q))


def energies(run: Run) -> np.ndarray:
    """V = s' M s / 2 + sum of a~^2 / (2 gamma) at samples."""
    plant, q = cast(MechanicalPlant, run.experiment.loop.plant), run.arrays["q"]
    scenario = run.experiment.alone or run.experiment.scenario
    known = plant.coefficients(scenario.parameters)
    s = _filtered(run, q, run.arrays["qd"], run.arrays["t"])
    mass = plant.mass_matrix(run.trajectory.t.new_tensor(q), known).numpy()
    rates = run.experiment.loop.constant("adaptation_rate").numpy()
    off = run.arrays["estimate"][..., 0] - known.a.numpy()
    return np.asarray(0.5 * np.einsum("ki,kij,kj->k", s, mass, s) + 0.5 * (off**2 / rates).sum(-1))


def ledger(run: Run) -> float:
    """V(0) - V(end) - integral of s' K_D s."""
    plant, steps = run.trajectory.plant, len(run.t)
    q, qd = (row.numpy().reshape(steps, -1) for row in (plant.q, plant.qd))
    V = energies(run)
    spent = simpson(run.t, FEEDBACK * np.square(_filtered(run, q, qd, run.t)).sum(-1))
    return float(V[0] - V[-1] - spent)


def largest_step(run: Run) -> float:
    """Of V, up, from sample to sample."""
    return float(np.diff(energies(run)).max())


PROBLEM = Problem(
    "Two links, four unknowns",
    "Slotine and Li 1987",
    {
        "adapting": Case(
            "adapting",
            ("problem=slotine_li",),
            0.01,
            (
                printed("max |e_1| [deg]", "3.24593", largest("error", 0, DEGREES)),
                printed("max |e_2| [deg]", "1.28838", largest("error", 1, DEGREES)),
                printed("a_1(3 s)", "0.173494", *mark("estimate", 3.0)),
                printed("a_2(3 s)", "0.660628", *mark("estimate", 3.0, 1)),
                printed("a_3(3 s)", "1.759230", *mark("estimate", 3.0, 2)),
                printed(
                    "a_4(3 s)",
                    "1.3200765",
                    *mark("estimate", 3.0, 3),
                    source="SciPy, rtol 1e-12",
                    note="benchmarks.md prints 1.320072",
                ),
                printed("V(0)", "201.335667", lambda run: float(energies(run)[0])),
                closed("V(0) - V(3 s) - int s' K_D s", 0.0, ledger, floor=1e-8),
                at_most(
                    "largest step up of V", 0.0, lambda run: float(np.diff(energies(run)).max())
                ),
            ),
            ("estimate",),
        ),
        "fixed": Case(
            "without adaptation",
            ("problem=slotine_li_fixed",),
            0.01,
            (
                printed("max |e_1| [deg]", "5.63447", largest("error", 0, DEGREES)),
                printed("max |e_2| [deg]", "2.25034", largest("error", 1, DEGREES)),
            ),
            ("estimate",),
        ),
    },
)
