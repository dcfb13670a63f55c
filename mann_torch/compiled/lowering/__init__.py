"""From torch operations to the compiler's nodes: one function an operation, by its name."""

from ..lowering import creation, indexing, linear, ordering, pointwise, reductions, rounding, shapes
from .lower import lower

__all__ = [
    "creation",
    "indexing",
    "linear",
    "lower",
    "ordering",
    "pointwise",
    "reductions",
    "rounding",
    "shapes",
]
