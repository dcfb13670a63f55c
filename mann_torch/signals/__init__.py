"""Reference trajectories and parameter schedules."""

from .reference import Reference, Sinusoid
from .schedule import PiecewiseConstant, growing_square, multiplied

__all__ = ["PiecewiseConstant", "Reference", "Sinusoid", "growing_square", "multiplied"]
