"""Contracts that a part of one's own must keep, as checks that say what to mend."""

from .plants import check_plant
from .references import check_reference

__all__ = ["check_plant", "check_reference"]
