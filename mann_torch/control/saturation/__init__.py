"""What protects adaptation from a limited input."""

from ...registry import Registry
from .augmented_error import AugmentedError
from .deficit import Deficit
from .hedging import Hedging
from .known_limits import KnownLimits
from .learned_deficit import LearnedDeficit
from .mu_modification import MuModification
from .saturation import Saturation

SATURATIONS: Registry[Saturation] = Registry(
    "saturation",
    Saturation,
    {
        "augmented_error": AugmentedError,
        "hedging": Hedging,
        "known_limits": KnownLimits,
        "mu_modification": MuModification,
    },
)

__all__ = [
    "SATURATIONS",
    "AugmentedError",
    "Deficit",
    "Hedging",
    "KnownLimits",
    "LearnedDeficit",
    "MuModification",
    "Saturation",
]
