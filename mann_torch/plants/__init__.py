"""Plants: systems to be controlled. They know nothing of controllers."""

from .mechanical import MechanicalPlant, Torque
from .plant import Field, Input, Plant
from .two_link_arm import ArmCoefficients, ArmParameters, TwoLinkArm, arm_parameters

PLANTS: dict[str, type[Plant]] = {"two_link_arm": TwoLinkArm}

__all__ = [
    "PLANTS",
    "ArmCoefficients",
    "ArmParameters",
    "Field",
    "Input",
    "MechanicalPlant",
    "Plant",
    "Torque",
    "TwoLinkArm",
    "arm_parameters",
]
