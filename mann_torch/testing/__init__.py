"""Contracts that a part of one's own must keep, as checks that say what to mend."""

from .attentions import check_attention
from .controllers import check_controller
from .key_rules import check_key_rule
from .laws import check_law
from .models import check_model
from .networks import check_network
from .plants import check_plant
from .references import check_reference
from .sensors import check_sensor

__all__ = [
    "check_attention",
    "check_controller",
    "check_key_rule",
    "check_law",
    "check_model",
    "check_network",
    "check_plant",
    "check_reference",
    "check_sensor",
]
