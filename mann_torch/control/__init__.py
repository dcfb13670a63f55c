"""Controllers. They know nothing of arms, signals or solvers."""

from .controller import Controller
from .feature_network import FeatureNetwork
from .mann import MannController
from .network import AdaptiveNetwork, equal_parameter_hidden
from .network_inputs import ErrorsAndReference, NetworkInputs
from .robust import RobustGain
from .tracking import FilteredTracking

__all__ = [
    "AdaptiveNetwork",
    "Controller",
    "ErrorsAndReference",
    "FeatureNetwork",
    "FilteredTracking",
    "MannController",
    "NetworkInputs",
    "RobustGain",
    "equal_parameter_hidden",
]
