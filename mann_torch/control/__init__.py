"""Controllers. They know nothing of arms, signals or solvers."""

from ..registry import Registry
from .controller import Controller
from .feature_network import FeatureNetwork
from .laws import LAWS, GradientLaw, Law
from .linear_feedback import LinearFeedback
from .mann import MannController
from .network import AdaptiveNetwork, equal_parameter_hidden
from .network_inputs import ErrorsAndReference, NetworkInputs
from .radial_basis import RadialBasisNetwork
from .robust import RobustGain
from .tracking import FilteredTracking

CONTROLLERS: Registry[Controller] = Registry(
    "controller", Controller, {"mann": MannController, "linear_feedback": LinearFeedback}
)
NETWORKS: Registry[FeatureNetwork] = Registry(
    "network",
    FeatureNetwork,
    {"adaptive": AdaptiveNetwork, "radial_basis": RadialBasisNetwork},
)

__all__ = [
    "CONTROLLERS",
    "LAWS",
    "NETWORKS",
    "AdaptiveNetwork",
    "Controller",
    "ErrorsAndReference",
    "FeatureNetwork",
    "FilteredTracking",
    "GradientLaw",
    "Law",
    "LinearFeedback",
    "MannController",
    "NetworkInputs",
    "RadialBasisNetwork",
    "RobustGain",
    "equal_parameter_hidden",
]
