"""From torch operations to the compiler's nodes: one function an operation, by its name."""

from . import (
    creation,
    distances,
    indexing,
    linear,
    ordering,
    pointwise,
    reductions,
    rounding,
    shapes,
)
from .lower import lower

__all__ = [
    "creation",
    "distances",
    "indexing",
    "linear",
    "lower",
    "ordering",
    "pointwise",
    "reductions",
    "rounding",
    "shapes",
]
