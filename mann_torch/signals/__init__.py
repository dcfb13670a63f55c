"""Reference trajectories and parameter schedules."""

from .disturbance import Disturbance, Forces, Outside, Surroundings
from .noise import MeasurementNoise, NoiseTable, noise_at
from .reference import Reference, Sampler, Sinusoid
from .rows import Rows
from .schedule import PiecewiseConstant, growing_square, multiplied

REFERENCES: dict[str, type[Reference]] = {"sinusoid": Sinusoid}

__all__ = [
    "REFERENCES",
    "Disturbance",
    "Forces",
    "MeasurementNoise",
    "NoiseTable",
    "Outside",
    "PiecewiseConstant",
    "Reference",
    "Rows",
    "Sampler",
    "Sinusoid",
    "Surroundings",
    "growing_square",
    "multiplied",
    "noise_at",
]
