"""A controller that leaves the simulator: a step at a fixed rate, in Python, in C, anywhere."""

from .blob import Blob
from .deploying import deploy
from .ports import Ports
from .stepper import Stepped, Stepper
from .tick import DIVERGED, REFUSED, SATURATED, Kept, Tick, Ticked

__all__ = [
    "DIVERGED",
    "REFUSED",
    "SATURATED",
    "Blob",
    "Kept",
    "Ports",
    "Stepped",
    "Stepper",
    "Tick",
    "Ticked",
    "deploy",
]
