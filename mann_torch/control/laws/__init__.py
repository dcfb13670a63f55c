"""Adaptive laws: how estimates move. One mechanism a file."""

from ...registry import Registry
from .gradient import GradientLaw
from .law import Law

LAWS: Registry[Law] = Registry("law", Law, {"gradient": GradientLaw})

__all__ = ["LAWS", "GradientLaw", "Law"]
