"""Plants: mechanical systems to be controlled. They know nothing of controllers."""

from .plant import Plant
from .two_link_arm import ArmCoefficients, ArmParameters, TwoLinkArm, arm_parameters

PLANTS: dict[str, type[Plant]] = {"two_link_arm": TwoLinkArm}

__all__ = ["PLANTS", "ArmCoefficients", "ArmParameters", "Plant", "TwoLinkArm", "arm_parameters"]
