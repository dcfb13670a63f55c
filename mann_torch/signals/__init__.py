"""Reference trajectories and parameter schedules."""

from .noise import MeasurementNoise, NoiseTable, noise_at
from .reference import Reference, Sinusoid
from .schedule import PiecewiseConstant, growing_square, multiplied

__all__ = [
    "MeasurementNoise",
    "NoiseTable",
    "PiecewiseConstant",
    "Reference",
    "Sinusoid",
    "growing_square",
    "multiplied",
    "noise_at",
]
