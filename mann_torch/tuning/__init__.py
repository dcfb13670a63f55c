"""Constants tuned by gradients that can be trusted."""

from .coordinates import FORMS, Coordinates
from .ensemble import Ensemble, Judge, Score, constants_at, score
from .gradients import MODES, PATHWISE, GradientSettings, control_of, pathwise_slopes, slope_of
from .objective import Objective
from .schedule import OPTIMIZERS, Schedule
from .slopes import Slope, differences, smoothed
from .tuner import Tuner

__all__ = [
    "FORMS",
    "MODES",
    "OPTIMIZERS",
    "PATHWISE",
    "Coordinates",
    "Ensemble",
    "GradientSettings",
    "Judge",
    "Objective",
    "Schedule",
    "Score",
    "Slope",
    "Tuner",
    "constants_at",
    "control_of",
    "differences",
    "pathwise_slopes",
    "score",
    "slope_of",
    "smoothed",
]
