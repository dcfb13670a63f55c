"""The loop's own parts: what stands between controller, plant and reference."""

from ..registry import Registry
from .actuator import Actuator
from .clock import Clock
from .reference_model import LinearModel, ReferenceModel, SecondOrderModel
from .sensor import Sensor

#: Names a configuration may use. A new reference model is one file and one line here.
MODELS: Registry[ReferenceModel] = Registry(
    "model", ReferenceModel, {"linear": LinearModel, "second_order": SecondOrderModel}
)

__all__ = [
    "MODELS",
    "Actuator",
    "Clock",
    "LinearModel",
    "ReferenceModel",
    "SecondOrderModel",
    "Sensor",
]
