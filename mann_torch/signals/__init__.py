"""Reference trajectories and parameter schedules."""

from .reference import Reference, Sampler, Sinusoid
from .schedule import PiecewiseConstant, growing_square, multiplied

__all__ = [
    "PiecewiseConstant",
    "Reference",
    "Sampler",
    "Sinusoid",
    "growing_square",
    "multiplied",
]
