"""What a model-reference controller follows."""

from __future__ import annotations

from torch import Tensor

from ...errors import ConfigError, ShapeError
from ...types import ReferenceSample


def followed(kind: str, reference: ReferenceSample) -> tuple[Tensor, Tensor]:
    """The model's state x_m (..., d) and command r (..., p). Raises `ConfigError` without one."""
    if reference.command is None or reference.state is None:
        raise ConfigError(f"{kind} follows a reference model: give the loop a `model`")
    return reference.state, reference.command


def check_followed(
    kind: str, reference: ReferenceSample, n_commands: int, n_states: int | None = None
) -> None:
    """Raise `ShapeError` unless the model is of these sizes, `ConfigError` without one."""
    state, command = followed(kind, reference)
    states, commands = state.shape[-1], command.shape[-1]
    if commands != n_commands or n_states not in (None, states):
        told = "" if n_states is None else f"{n_states} states and "
        raise ShapeError(
            f"a reference model of {states} states and {commands} commands got {kind} of {told}"
            f"{n_commands} commands"
        )
