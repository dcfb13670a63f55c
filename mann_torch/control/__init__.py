"""Controllers. They know nothing of arms, signals or solvers."""

from .controller import Controller
from .mann import MannController
from .network import AdaptiveNetwork, equal_parameter_hidden
from .robust import RobustGain
from .tracking import FilteredTracking

__all__ = [
    "AdaptiveNetwork",
    "Controller",
    "FilteredTracking",
    "MannController",
    "RobustGain",
    "equal_parameter_hidden",
]
