"""Reference trajectories and parameter schedules."""

from .noise import MeasurementNoise, NoiseTable, noise_at, scaled
from .reference import Reference, Sampler, Sinusoid
from .schedule import PiecewiseConstant, growing_square, multiplied

__all__ = [
    "MeasurementNoise",
    "NoiseTable",
    "PiecewiseConstant",
    "Reference",
    "Sampler",
    "Sinusoid",
    "growing_square",
    "multiplied",
    "noise_at",
    "scaled",
]
