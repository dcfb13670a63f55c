"""What adapts: bases, networks of weights on them, and a memory beside them."""

from ...registry import Registry
from .adaptive_network import AdaptiveNetwork
from .approximator import Approximation, Approximator
from .bases import Constant, FunctionBasis, Identity, Joined
from .basis import Basis
from .equal_parameters import equal_parameter_hidden
from .feature_network import FeatureNetwork
from .layers import Layers
from .linear_network import LinearNetwork, LinearWeights
from .network_inputs import ErrorsAndReference, Measured, NetworkInputs
from .radial_basis import RadialBasis
from .readouts import Readouts, ReadoutState

BASES: Registry[Basis] = Registry(
    "basis",
    Basis,
    {"constant": Constant, "identity": Identity, "layers": Layers, "radial": RadialBasis},
    several="bases",
)
NETWORKS: Registry[FeatureNetwork] = Registry(
    "network", FeatureNetwork, {"adaptive": AdaptiveNetwork, "linear": LinearNetwork}
)

__all__ = [
    "BASES",
    "NETWORKS",
    "AdaptiveNetwork",
    "Approximation",
    "Approximator",
    "Basis",
    "Constant",
    "ErrorsAndReference",
    "FeatureNetwork",
    "FunctionBasis",
    "Identity",
    "Joined",
    "Layers",
    "LinearNetwork",
    "LinearWeights",
    "Measured",
    "NetworkInputs",
    "RadialBasis",
    "ReadoutState",
    "Readouts",
    "equal_parameter_hidden",
]
