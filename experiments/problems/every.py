"""All problems, by name, in the order of shared/benchmarks.md."""

from __future__ import annotations

from . import estimators, l1, limited_input, quadrotor, rohrs, scalar_mrac, slotine_li, wing_rock
from .known import Problem

PROBLEMS: dict[str, Problem] = {
    "quadrotor": quadrotor.PROBLEM,
    "rohrs": rohrs.PROBLEM,
    "slotine_li": slotine_li.PROBLEM,
    "wing_rock": wing_rock.PROBLEM,
    "estimators": estimators.PROBLEM,
    "scalar_mrac": scalar_mrac.PROBLEM,
    "limited_input": limited_input.PROBLEM,
    "l1": l1.PROBLEM,
}
