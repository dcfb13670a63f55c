"""A sequence on both engines, under every attention with every key rule."""

from __future__ import annotations

import pytest
import torch
from torch import Tensor

import mann_torch as mt
from tests.contracts.test_cell_contract import CELLS, B, make_cell, somewhere, stream

#: What differs most; `make check` runs them all.
FIRST = {("reallocating_always", "state"), ("soft", "state/default")}
quick_cells = pytest.mark.parametrize(
    ("attention", "rule"),
    [pair if pair in FIRST else pytest.param(*pair, marks=pytest.mark.slow) for pair in CELLS],
)


def both(
    cell: mt.MemoryCell, x: Tensor, **given: Tensor
) -> list[tuple[Tensor, mt.CellState, list[Tensor]]]:
    """Outputs, last state, and gradients to x, the first contents and all parameters."""
    free = [p for p in cell.parameters() if p.requires_grad and p.numel()]
    found = []
    for engine in ("compiled", "torch"):
        state = somewhere(cell).detach()
        state.mu.requires_grad_(True)
        leaf = x.detach().requires_grad_(True)
        outputs, last = mt.MemorySequence(cell, engine=engine)(leaf, state, **given)
        loss = outputs.sin().sum() + last.mu.square().sum() + last.keys.sum()
        slopes = torch.autograd.grad(loss, [leaf, state.mu, *free], allow_unused=True)
        whole = [
            torch.zeros_like(p) if g is None else g
            for p, g in zip([leaf, state.mu, *free], slopes, strict=True)
        ]
        found.append((outputs, last, whole))
    return found


def close(mine: Tensor, theirs: Tensor, share: float) -> None:
    if not mine.is_floating_point():
        assert torch.equal(mine, theirs)
        return
    scale = float(theirs.detach().abs().max()) if theirs.numel() else 0.0
    torch.testing.assert_close(mine, theirs, rtol=0, atol=share * max(scale, 1.0))


@quick_cells
@pytest.mark.parametrize(("dtype", "share"), [(torch.float64, 1e-11), (torch.float32, 1e-5)])
def test_both_engines_agree_in_values_and_gradients(
    attention: str, rule: str, dtype: torch.dtype, share: float
) -> None:
    cell = make_cell(attention, rule).to(dtype)
    if "temperature" in cell.constants():
        cell.initialize(temperature=1.0)
    cell.tune(*cell.constants())
    mine, theirs = both(cell, stream(B, steps=25, dtype=dtype))
    close(mine[0], theirs[0], share)
    for one, other in zip(mine[1], theirs[1], strict=True):
        close(one, other, share)
    for one, other in zip(mine[2], theirs[2], strict=True):
        close(one, other, share)
    assert sum(bool((g != 0).any()) for g in theirs[2]) >= 6


@quick_cells
def test_marks_begin_anew_and_stand_still_exactly(attention: str, rule: str) -> None:
    cell, T = make_cell(attention, rule).double(), 12
    x = stream(B, steps=T, dtype=torch.float64)
    reset, valid = torch.zeros(T, B, dtype=torch.bool), torch.ones(T, B, dtype=torch.bool)
    reset[5, 1], valid[8:, 2], valid[3, 3] = True, False, False
    for engine in ("compiled", "torch"):
        sequence = mt.MemorySequence(cell, engine=engine)
        outputs, last = sequence(x, reset=reset, valid=valid)
        fresh, end = sequence(x[5:])  # as if the episode began there
        assert torch.equal(outputs[5:, 1], fresh[:, 1])
        assert all(torch.equal(a[1], b[1]) for a, b in zip(last, end, strict=True))
        short, stopped = sequence(x[:8])
        assert torch.equal(outputs[:8, 2], short[:, 2])
        assert not outputs[8:, 2].any() and not outputs[3, 3].any()
        assert all(torch.equal(a[2], b[2]) for a, b in zip(last, stopped, strict=True))
        skipped, other = sequence(torch.cat([x[:3], x[4:]]))
        close(outputs[4:, 3], skipped[3:, 3], 1e-14)
        close(last.mu[3], other.mu[3], 1e-14)


def test_a_batch_of_constants_is_a_batch_of_cells_on_the_compiled_engine() -> None:
    cell = make_cell("soft", "state").double()
    x, gains = stream(dtype=torch.float64), [0.4, 0.9]
    cell.initialize(write_gain=gains)
    cell.tune("write_gain")
    sequence = mt.MemorySequence(cell, engine="compiled")
    outputs, _ = sequence(x)
    (slope,) = torch.autograd.grad(outputs.square().sum((0, 2)).sum(), cell.memory.write_gain)
    for i, gain in enumerate(gains):
        cell.initialize(write_gain=gain)
        alone = sequence(x)[0]
        close(outputs[:, i], alone, 1e-12)
        (mine,) = torch.autograd.grad(alone.square().sum(), cell.memory.write_gain)
        close(slope[i], mine, 1e-12)
