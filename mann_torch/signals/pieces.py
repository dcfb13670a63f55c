"""Pieces of time, each sample's own: which one has begun, and the row that belongs to it."""

from __future__ import annotations

import torch
from torch import Tensor

from ..errors import ConfigError, ShapeError


def begun(times: Tensor, t: Tensor) -> Tensor:
    """How many of the times (..., K) are not after t (..., 1): (...,) int64."""
    return (times <= t).sum(dim=-1)


def row_at(rows: Tensor, index: Tensor) -> Tensor:
    """Row number `index` (...,) of rows (..., K, p): (..., p)."""
    batch = index.shape
    rows = rows.expand(*batch, *rows.shape[-2:])
    index = index[..., None, None].expand(*batch, 1, rows.shape[-1])
    return rows.gather(-2, index).squeeze(-2)


def check_increasing(kind: str, times: Tensor) -> None:
    """Raise `ConfigError` for times (..., K) that do not increase."""
    if bool((torch.diff(times.detach(), dim=-1) <= 0).any()):
        raise ConfigError(f"{kind} times = {times.tolist()}: must increase")


def check_knots(kind: str, times: Tensor, name: str, rows: Tensor, least: int = 2) -> None:
    """Raise unless times (..., K) increase, at least so many, with a row (..., K, p) for each.

    `ShapeError` or `ConfigError`.
    """
    fit = times.dim() > 0 and rows.dim() > 1 and rows.shape[-2] == times.shape[-1]
    if not fit or times.shape[-1] < least:
        raise ShapeError(
            f"{kind} of times {tuple(times.shape)} and {name} {tuple(rows.shape)}: at least "
            f"{least} times and a row for each are needed"
        )
    check_increasing(kind, times)
