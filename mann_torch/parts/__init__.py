"""The loop's own parts: what stands between controller, plant and reference."""

from .actuator import Actuator
from .clock import Clock
from .reference_model import LinearModel, ReferenceModel, SecondOrderModel
from .sensor import Sensor

__all__ = ["Actuator", "Clock", "LinearModel", "ReferenceModel", "SecondOrderModel", "Sensor"]
