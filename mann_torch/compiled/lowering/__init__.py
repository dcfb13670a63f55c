"""From torch operations to the compiler's nodes: one function an operation, by its name."""

from . import indexing, linear, pointwise, reductions, shapes
from .lower import lower

__all__ = ["indexing", "linear", "lower", "pointwise", "reductions", "shapes"]
