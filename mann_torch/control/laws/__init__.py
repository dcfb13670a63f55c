"""Adaptive laws: how estimates move. One mechanism a file, composed by `AdaptiveLaw`."""

from ...registry import Registry
from .adaptive import AdaptiveLaw
from .box_projection import BoxProjection
from .composite import Composite
from .concurrent_learning import ConcurrentLearning
from .constant_gain import ConstantGain
from .dead_zone import DeadZone
from .drem import Drem
from .drive import Drive, Pair
from .e_modification import EModification
from .freeze_while_saturated import FreezeWhileSaturated
from .law import Law
from .least_squares import LeastSquares
from .normalisation import Normalisation
from .part import Gain, GainInForce, Gate, Guard, LawPart, Leak, Term
from .projection import Projection
from .sigma_modification import SigmaModification
from .switching_sigma import SwitchingSigma

LAWS: Registry[Law] = Registry("law", Law, {"adaptive": AdaptiveLaw, "drem": Drem})
#: What an adaptive law is composed of.
LAW_PARTS: Registry[LawPart] = Registry(
    "law_part",
    LawPart,
    {
        "composite": Composite,
        "concurrent_learning": ConcurrentLearning,
        "constant": ConstantGain,
        "dead_zone": DeadZone,
        "e_modification": EModification,
        "freeze_while_saturated": FreezeWhileSaturated,
        "least_squares": LeastSquares,
        "normalisation": Normalisation,
        "projection": Projection,
        "box_projection": BoxProjection,
        "sigma": SigmaModification,
        "switching_sigma": SwitchingSigma,
    },
)

__all__ = [
    "LAWS",
    "LAW_PARTS",
    "AdaptiveLaw",
    "BoxProjection",
    "Composite",
    "ConcurrentLearning",
    "ConstantGain",
    "DeadZone",
    "Drem",
    "Drive",
    "EModification",
    "FreezeWhileSaturated",
    "Gain",
    "GainInForce",
    "Gate",
    "Guard",
    "Law",
    "LawPart",
    "Leak",
    "LeastSquares",
    "Normalisation",
    "Pair",
    "Projection",
    "SigmaModification",
    "SwitchingSigma",
    "Term",
]
