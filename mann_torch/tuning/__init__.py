"""Constants tuned by gradients that can be trusted."""

from .coordinates import FORMS, Coordinates
from .criterion import Criterion, Limit
from .ensemble import Ensemble, Score, constants_at, score
from .gradients import MODES, PATHWISE, GradientSettings, control_of, pathwise_slopes, slope_of
from .judges import EVERYTHING, MOTION, TOTALS, Judge, Judged, Recording
from .objective import Aim, Objective
from .schedule import OPTIMIZERS, Schedule
from .slopes import Slope, differences, smoothed
from .tuner import Tuner

__all__ = [
    "EVERYTHING",
    "FORMS",
    "MODES",
    "MOTION",
    "OPTIMIZERS",
    "PATHWISE",
    "TOTALS",
    "Aim",
    "Coordinates",
    "Criterion",
    "Ensemble",
    "GradientSettings",
    "Judge",
    "Judged",
    "Limit",
    "Objective",
    "Recording",
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
