"""Model-reference adaptive control."""

from .mrac import Mrac

__all__ = ["Mrac"]
