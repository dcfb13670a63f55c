"""Whether a controller has what a law reads."""

from __future__ import annotations

from collections.abc import Iterable

from ...errors import ConfigError
from .law import Law


def check_needs(law: Law, offers: Iterable[str]) -> None:
    """Raise `ConfigError` where a law needs fields of a `Drive` that a controller lacks."""
    lacking = sorted(law.needs - set(offers))
    if lacking:
        raise ConfigError(
            f"law: {type(law).__name__} needs {', '.join(lacking)} of a drive, this "
            f"controller gives {', '.join(sorted(offers)) or 'none of it'}"
        )
