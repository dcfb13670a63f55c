"""Constants tuned by gradients that can be trusted."""

from .coordinates import FORMS, Coordinates
from .ensemble import Ensemble, Judge, Score, constants_at, score
from .gradients import MODES, PATHWISE, GradientSettings, pathwise_slopes, slope_of
from .objective import Objective
from .slopes import Slope, differences, smoothed
from .tuner import OPTIMIZERS, Schedule, Tuner

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
    "differences",
    "pathwise_slopes",
    "score",
    "slope_of",
    "smoothed",
]
