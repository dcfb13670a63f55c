"""Friction of joints: viscous, and Coulomb's smoothed so that it has a derivative."""

from __future__ import annotations

import torch
from torch import Tensor


def unless_zero(value: Tensor) -> Tensor | None:
    """A row of friction, or None where there is none and no gradient is asked for."""
    return None if not value.requires_grad and not bool(value.any()) else value


def with_friction(
    load: Tensor, qd: Tensor, viscous: Tensor | None, coulomb: Tensor | None, velocity: float
) -> Tensor:
    """load + viscous qd + coulomb tanh(qd / velocity), all (..., n) [N m]."""
    if viscous is not None:
        load = load + viscous * qd
    if coulomb is not None:
        load = load + coulomb * torch.tanh(qd / velocity)
    return load


def friction_slope(
    qd: Tensor, viscous: Tensor | None, coulomb: Tensor | None, velocity: float
) -> Tensor | None:
    """d(friction)/d(qd) (..., n) [N m s/rad]; None without friction."""
    if coulomb is None:
        return viscous
    bend = 1.0 - torch.tanh(qd / velocity).square()
    steep = coulomb * bend / velocity
    return steep if viscous is None else viscous + steep
