"""L1 adaptive control: predictor, fast estimates, and an input through a filter."""

from .adaptation import Estimated, L1Adaptation, PredictorGradient
from .controller import L1Adaptive
from .norm import l1_gain, l1_norm
from .piecewise_constant import PiecewiseConstant

__all__ = [
    "Estimated",
    "L1Adaptation",
    "L1Adaptive",
    "PiecewiseConstant",
    "PredictorGradient",
    "l1_gain",
    "l1_norm",
]
