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
from .labels import LABELS, FilteredLabels, Labels, MeasuredLabels
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
from .mrac import InputOutputFilters, Mrac, OutputMrac
from .robust import RobustGain
from .saturation import SATURATIONS, AugmentedError, Hedging, MuModification, Saturation
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
        "mrac": Mrac,
        "output_mrac": OutputMrac,
    },
)

__all__ = [
    "BASES",
    "CONTROLLERS",
    "LABELS",
    "LAWS",
    "LAW_PARTS",
    "NETWORKS",
    "SATURATIONS",
    "AdaptiveLaw",
    "AdaptiveNetwork",
    "Approximation",
    "Approximator",
    "AugmentedError",
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
    "FilteredLabels",
    "FilteredTracking",
    "FunctionBasis",
    "Gain",
    "GainInForce",
    "Gate",
    "Guard",
    "Hedging",
    "Identity",
    "InputOutputFilters",
    "IntegralAction",
    "Joined",
    "L1Adaptive",
    "Labels",
    "Law",
    "LawPart",
    "Layers",
    "Leak",
    "LinearFeedback",
    "LinearNetwork",
    "MannController",
    "Measured",
    "MeasuredLabels",
    "Mechanics",
    "MetaAdaptive",
    "Mrac",
    "MuModification",
    "NetworkInputs",
    "OutputMrac",
    "Pair",
    "Projection",
    "RadialBasis",
    "RobustGain",
    "Saturation",
    "SigmaModification",
    "SlotineLi",
    "Term",
    "equal_parameter_hidden",
    "l1_gain",
    "l1_norm",
]
