"""Pieces of time, each sample's own: which one has begun, and the row that belongs to it."""

from __future__ import annotations

import torch
from torch import Tensor

from ..errors import ConfigError


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
