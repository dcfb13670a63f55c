"""Reference trajectories and parameter schedules."""

from ..registry import Registry
from .disturbance import Disturbance, Forces, Outside, Surroundings
from .noise import MeasurementNoise, NoiseTable, noise_at
from .polynomial import Polynomial
from .reference import Reference, Sampler
from .rows import Rows
from .schedule import PiecewiseConstant, growing_square
from .sinusoid import Sinusoid
from .sinusoids import Sinusoids
from .smooth_steps import SmoothSteps
from .spline import Spline
from .square_wave import SquareWave
from .steps import Steps
from .sum import Sum
from .waypoints import MinimumJerk, Quintic

REFERENCES: Registry[Reference] = Registry(
    "reference",
    Reference,
    {
        "sinusoid": Sinusoid,
        "sinusoids": Sinusoids,
        "steps": Steps,
        "square_wave": SquareWave,
        "smooth_steps": SmoothSteps,
        "minimum_jerk": MinimumJerk,
        "quintic": Quintic,
        "polynomial": Polynomial,
        "sum": Sum,
        "spline": Spline,
    },
)

__all__ = [
    "REFERENCES",
    "Disturbance",
    "Forces",
    "MeasurementNoise",
    "MinimumJerk",
    "NoiseTable",
    "Outside",
    "PiecewiseConstant",
    "Polynomial",
    "Quintic",
    "Reference",
    "Rows",
    "Sampler",
    "Sinusoid",
    "Sinusoids",
    "SmoothSteps",
    "Spline",
    "SquareWave",
    "Steps",
    "Sum",
    "Surroundings",
    "growing_square",
    "noise_at",
]
