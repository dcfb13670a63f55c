"""The state among what is measured."""

from __future__ import annotations

from typing import Any

from torch import Tensor

from ...errors import ConfigError, ShapeError


def state_of(measurement: Any, field: str | None) -> list[Tensor]:
    """All fields of a measurement, less the last where a label's `field` is told."""
    return list(measurement)[: None if field is None else -1]


def check_measured_state(measurement: Any, field: str | None, n_inputs: int, n_states: int) -> None:
    """Raise `ConfigError` or `ShapeError` unless n numbers are measured, and the field's m."""
    names = measurement._fields
    if field is not None and (len(names) < 2 or names[-1] != field):
        raise ConfigError(
            f"labels: '{field}' must be the last field of the measurement, after the state's; "
            f"measured are {', '.join(names)}"
        )
    if field is not None and measurement[-1].shape[-1] != n_inputs:
        raise ShapeError(f"labels: '{field}' must have {n_inputs} numbers, one an input")
    found = sum(part.shape[-1] for part in state_of(measurement, field))
    if found != n_states:
        raise ShapeError(f"error_gain of {n_states} states: {found} are measured")
