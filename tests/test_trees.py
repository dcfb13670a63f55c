"""Trees packed into one tensor, and back."""

from __future__ import annotations

from typing import NamedTuple

import torch
from torch import Tensor

from mann_torch.trees import Packer, leaves
from tests.conftest import randn


class Mixed(NamedTuple):
    matrix: Tensor  # (..., 2, 3)
    number: Tensor  # (...,)
    row: Tensor  # (..., 2)


def test_leaves_of_any_shape_come_back_as_they_were() -> None:
    tree = Mixed(randn(4, 2, 3), randn(4, seed=1), randn(4, 2, seed=2))
    packer = Packer(tree, 1)
    flat = packer.pack(tree)
    assert flat.shape == (4, 9)
    for before, after in zip(leaves(tree), leaves(packer.unpack(flat)), strict=True):
        assert torch.equal(before, after)
