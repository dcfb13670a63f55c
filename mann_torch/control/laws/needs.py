"""Whether a controller has what a law reads."""

from __future__ import annotations

from collections.abc import Iterable

from ...errors import ConfigError
from .law import Law


def check_needs(law: Law, offers: Iterable[str], rows: int = 1) -> None:
    """Raise `ConfigError` where a law needs fields of a `Drive` that a controller lacks.

    Or regressors (..., N, r) of another r than its `rows`.
    """
    lacking = sorted(law.needs - set(offers))
    if lacking:
        raise ConfigError(
            f"law: {type(law).__name__} needs {', '.join(lacking)} of a drive, this "
            f"controller gives {', '.join(sorted(offers)) or 'none of it'}"
        )
    if law.rows not in (None, rows):
        raise ConfigError(
            f"law: {type(law).__name__} takes regressors (N, r) of r = {law.rows}, this "
            f"controller's have r = {rows}"
        )
