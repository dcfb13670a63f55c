"""Reference trajectories and parameter schedules."""

from .noise import MeasurementNoise, NoiseTable, noise_at, scaled
from .reference import Reference, Sampler, Sinusoid
from .rows import Rows
from .schedule import PiecewiseConstant, growing_square, multiplied

REFERENCES: dict[str, type[Reference]] = {"sinusoid": Sinusoid}

__all__ = [
    "REFERENCES",
    "MeasurementNoise",
    "NoiseTable",
    "PiecewiseConstant",
    "Reference",
    "Rows",
    "Sampler",
    "Sinusoid",
    "growing_square",
    "multiplied",
    "noise_at",
    "scaled",
]
