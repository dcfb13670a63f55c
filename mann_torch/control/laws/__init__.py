"""Adaptive laws: how estimates move. One mechanism a file, composed by `AdaptiveLaw`."""

from ...registry import Registry
from .adaptive import AdaptiveLaw
from .box_projection import BoxProjection
from .constant_gain import ConstantGain
from .drive import Drive, Pair
from .e_modification import EModification
from .law import Law
from .part import Gain, GainInForce, Gate, Guard, LawPart, Leak, Term
from .projection import Projection
from .sigma_modification import SigmaModification

LAWS: Registry[Law] = Registry("law", Law, {"adaptive": AdaptiveLaw})
#: What an adaptive law is composed of.
LAW_PARTS: Registry[LawPart] = Registry(
    "law_part",
    LawPart,
    {
        "constant": ConstantGain,
        "sigma": SigmaModification,
        "e_modification": EModification,
        "projection": Projection,
        "box_projection": BoxProjection,
    },
)

__all__ = [
    "LAWS",
    "LAW_PARTS",
    "AdaptiveLaw",
    "BoxProjection",
    "ConstantGain",
    "Drive",
    "EModification",
    "Gain",
    "GainInForce",
    "Gate",
    "Guard",
    "Law",
    "LawPart",
    "Leak",
    "Pair",
    "Projection",
    "SigmaModification",
    "Term",
]
