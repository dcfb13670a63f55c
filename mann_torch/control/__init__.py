"""Controllers. They know nothing of arms, signals or solvers."""

from ..registry import Registry
from .boundary_layer import BoundaryLayer
from .controller import Controller
from .features import (
    BASES,
    NETWORKS,
    AdaptiveNetwork,
    Approximation,
    Approximator,
    Basis,
    Constant,
    ErrorsAndReference,
    FeatureNetwork,
    FunctionBasis,
    Identity,
    Joined,
    Layers,
    LinearNetwork,
    Measured,
    NetworkInputs,
    RadialBasis,
    equal_parameter_hidden,
)
from .integral import IntegralAction
from .l1 import L1Adaptive, l1_gain, l1_norm
from .laws import (
    LAW_PARTS,
    LAWS,
    AdaptiveLaw,
    BoxProjection,
    ConstantGain,
    Drive,
    EModification,
    Gain,
    GainInForce,
    Gate,
    Guard,
    Law,
    LawPart,
    Leak,
    Pair,
    Projection,
    SigmaModification,
    Term,
)
from .linear_feedback import LinearFeedback
from .mann import MannController
from .mechanics import Mechanics
from .meta_adaptive import MetaAdaptive
from .robust import RobustGain
from .slotine_li import SlotineLi
from .tracking import FilteredTracking

CONTROLLERS: Registry[Controller] = Registry(
    "controller",
    Controller,
    {
        "mann": MannController,
        "linear_feedback": LinearFeedback,
        "l1": L1Adaptive,
        "meta_adaptive": MetaAdaptive,
        "slotine_li": SlotineLi,
    },
)

__all__ = [
    "BASES",
    "CONTROLLERS",
    "LAWS",
    "LAW_PARTS",
    "NETWORKS",
    "AdaptiveLaw",
    "AdaptiveNetwork",
    "Approximation",
    "Approximator",
    "Basis",
    "BoundaryLayer",
    "BoxProjection",
    "Constant",
    "ConstantGain",
    "Controller",
    "Drive",
    "EModification",
    "ErrorsAndReference",
    "FeatureNetwork",
    "FilteredTracking",
    "FunctionBasis",
    "Gain",
    "GainInForce",
    "Gate",
    "Guard",
    "Identity",
    "IntegralAction",
    "Joined",
    "L1Adaptive",
    "Law",
    "LawPart",
    "Layers",
    "Leak",
    "LinearFeedback",
    "LinearNetwork",
    "MannController",
    "Measured",
    "Mechanics",
    "MetaAdaptive",
    "NetworkInputs",
    "Pair",
    "Projection",
    "RadialBasis",
    "RobustGain",
    "SigmaModification",
    "SlotineLi",
    "Term",
    "equal_parameter_hidden",
    "l1_gain",
    "l1_norm",
]
