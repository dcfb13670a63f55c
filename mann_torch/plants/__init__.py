"""Plants: systems to be controlled. They know nothing of controllers."""

from ..registry import Registry
from .cart_pole import CartPole, CartPoleParameters
from .double_integrator import DoubleIntegrator, DoubleIntegratorParameters
from .first_order import MeasuredOutput, RowState
from .flexible_joint_arm import (
    FlexibleJointArm,
    FlexibleJointCoefficients,
    FlexibleJointParameters,
)
from .linear import LinearCoefficients, LinearParameters, LinearPlant, controllable_form
from .mechanical import MechanicalPlant, Torque
from .n_link_arm import NLinkArm, NLinkCoefficients, NLinkParameters
from .pendulum import Pendulum, PendulumCoefficients, PendulumParameters
from .plant import Field, Input, Plant, channels, zeros
from .quadrotor import PlanarQuadrotor, QuadrotorParameters
from .regression import Regression, RegressionMeasurement, RegressionParameters, RegressionState
from .rohrs import RohrsPlant
from .slotine_li_arm import SlotineLiArm, SlotineLiParameters, lumped
from .two_link_arm import ArmCoefficients, ArmParameters, TwoLinkArm, arm_parameters
from .wing_rock import CHOWDHARY_JOHNSON, ELZEBDA, WingRock, WingRockMeasurement, WingRockParameters

PLANTS: Registry[Plant] = Registry(
    "plant",
    Plant,
    {
        "two_link_arm": TwoLinkArm,
        "n_link_arm": NLinkArm,
        "flexible_joint_arm": FlexibleJointArm,
        "slotine_li_arm": SlotineLiArm,
        "wing_rock": WingRock,
        "planar_quadrotor": PlanarQuadrotor,
        "linear": LinearPlant,
        "rohrs": RohrsPlant,
        "regression": Regression,
        "cart_pole": CartPole,
        "pendulum": Pendulum,
        "double_integrator": DoubleIntegrator,
    },
)

__all__ = [
    "CHOWDHARY_JOHNSON",
    "ELZEBDA",
    "PLANTS",
    "ArmCoefficients",
    "ArmParameters",
    "CartPole",
    "CartPoleParameters",
    "DoubleIntegrator",
    "DoubleIntegratorParameters",
    "Field",
    "FlexibleJointArm",
    "FlexibleJointCoefficients",
    "FlexibleJointParameters",
    "Input",
    "LinearCoefficients",
    "LinearParameters",
    "LinearPlant",
    "MeasuredOutput",
    "MechanicalPlant",
    "NLinkArm",
    "NLinkCoefficients",
    "NLinkParameters",
    "Pendulum",
    "PendulumCoefficients",
    "PendulumParameters",
    "PlanarQuadrotor",
    "Plant",
    "QuadrotorParameters",
    "Regression",
    "RegressionMeasurement",
    "RegressionParameters",
    "RegressionState",
    "RohrsPlant",
    "RowState",
    "SlotineLiArm",
    "SlotineLiParameters",
    "Torque",
    "TwoLinkArm",
    "WingRock",
    "WingRockMeasurement",
    "WingRockParameters",
    "arm_parameters",
    "channels",
    "controllable_form",
    "lumped",
    "zeros",
]
