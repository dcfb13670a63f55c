"""The cell that these tests share."""

from __future__ import annotations

import torch

import mann_torch as mt
from tests.conftest import make_attention

WIDTH, N, S = 3, 6, 4


def make_cell(name: str = "soft", **options: object) -> mt.MemoryCell:
    torch.manual_seed(0)
    return mt.MemoryCell.paper(WIDTH, N, S, make_attention(name), dtype=torch.float64, **options)
