"""Adaptive laws: how estimates move. One mechanism a file."""

from .gradient import GradientLaw
from .law import Law

LAWS: dict[str, type[Law]] = {"gradient": GradientLaw}

__all__ = ["LAWS", "GradientLaw", "Law"]
