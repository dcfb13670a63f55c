"""From torch operations to the compiler's nodes: one function an operation, by its name."""

from . import (
    activations,
    creation,
    distances,
    indexing,
    joining,
    linear,
    ordering,
    pointwise,
    reductions,
    rounding,
    shapes,
    strided,
)
from .lower import lower

__all__ = [
    "activations",
    "creation",
    "distances",
    "indexing",
    "joining",
    "linear",
    "lower",
    "ordering",
    "pointwise",
    "reductions",
    "rounding",
    "shapes",
    "strided",
]
