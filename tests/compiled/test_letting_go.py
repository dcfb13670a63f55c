"""What a march kept for its gradient goes when nobody can ask for it any more."""

import gc

import pytest
import torch

import mann_torch as mt
from mann_torch.compiled.march.engine import Marcher


def alive() -> int:
    gc.collect()
    return sum(type(found) is Marcher for found in gc.get_objects())


@pytest.mark.parametrize("backward", [True, False])
def test_a_sequence_leaves_nothing_behind(backward: bool) -> None:
    sequence = mt.MemorySequence(mt.MemoryCell(2, 4, 2, output_size=1), engine="compiled")
    before = alive()
    outputs = sequence(torch.ones(3, 2, 2))[0]
    assert alive() == before + 1  # its gradient may be asked for
    if backward:
        outputs.sum().backward()
    del outputs
    assert alive() == before
