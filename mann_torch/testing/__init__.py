"""Contract checks for parts of one's own: each holds a part to its interface in one call."""

from .plants import check_plant

__all__ = ["check_plant"]
