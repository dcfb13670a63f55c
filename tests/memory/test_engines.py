"""Which engine takes a sequence, and what it says of it."""

from __future__ import annotations

import pytest
import torch
from torch import Tensor

import mann_torch as mt
from mann_torch.types import Comparison
from tests.conftest import randn
from tests.memory.cells import WIDTH, make_cell


def test_it_says_which_engine_takes_it_and_why() -> None:
    x = randn(4, 2, WIDTH)
    assert mt.MemorySequence(make_cell()).taken(x).engine == "compiled"
    assert mt.MemorySequence(make_cell(), engine="torch").taken(x) == ("torch", "engine='torch'")
    hooked = make_cell()
    hooked.memory.attention.register_forward_hook(lambda *_: None)
    assert "hooks" in mt.MemorySequence(hooked).taken(x).reason
    half = make_cell().bfloat16()
    assert "bfloat16" in mt.MemorySequence(half).taken(x.bfloat16()).reason
    with pytest.raises(mt.ConfigError, match="hooks are not called"):
        mt.MemorySequence(hooked, engine="compiled")(x)
    with pytest.raises(mt.ConfigError, match="engine"):
        mt.MemorySequence(make_cell(), engine="fast")


def test_cells_that_differ_in_one_option_do_not_share_a_program() -> None:
    x = randn(6, 2, WIDTH)
    for options in ({"clock": True}, {}, {"writing": "next"}, {"reset": "raw"}):
        cell = make_cell(key_rule=mt.StateKeys(), **options)
        expected = mt.MemorySequence(cell, engine="torch")(x)[0]
        found = mt.MemorySequence(cell, engine="compiled")(x)[0]
        torch.testing.assert_close(found, expected, rtol=0, atol=1e-13)


class Counting(mt.SoftAttention):
    """An attention that asks Python for a number."""

    def forward(self, comparison: Comparison, active: Tensor) -> Tensor:
        weights = super().forward(comparison, active)
        return weights if float(weights.sum()) > 0 else 2 * weights


class Flat(mt.SoftAttention):
    """The same weight on every slot in use."""

    def forward(self, comparison: Comparison, active: Tensor) -> Tensor:
        used = active.to(comparison.query.dtype)
        return used / used.sum(-1, keepdim=True)


def test_an_attention_of_ones_own_is_compiled_or_named() -> None:
    x = randn(6, 2, WIDTH)
    cell = make_cell()
    cell.memory.attention = Flat()
    sequence = mt.MemorySequence(cell)
    assert sequence.taken(x).engine == "compiled"
    expected = mt.MemorySequence(cell, engine="torch")(x)[0]
    torch.testing.assert_close(sequence(x)[0], expected, rtol=0, atol=1e-14)
    cell.memory.attention = Counting()
    found = sequence.taken(x)
    assert found.engine == "torch" and "Counting" in found.reason


def test_a_second_derivative_is_refused_and_torch_func_goes_to_torch() -> None:
    cell, x = make_cell(), randn(5, WIDTH).requires_grad_()
    sequence = mt.MemorySequence(cell)
    (slope,) = torch.autograd.grad(sequence(x)[0].square().sum(), x, create_graph=True)
    with pytest.raises(mt.KernelError, match="first derivatives only"):
        torch.autograd.grad(slope.sum(), x)
    jacobian = torch.func.jacrev(lambda given: sequence(given)[0].sum())(x.detach())
    (same,) = torch.autograd.grad(sequence(x)[0].sum(), x)
    torch.testing.assert_close(jacobian, same, rtol=0, atol=1e-13)


@pytest.mark.slow
def test_torch_compile_leaves_the_steps_to_the_compiled_engine() -> None:
    model = torch.nn.Sequential(torch.nn.Linear(WIDTH, WIDTH).double(), Last(make_cell()))
    x = randn(200, 2, WIDTH)
    torch._dynamo.reset()
    compiled = torch.compile(model, backend="aot_eager")
    torch.testing.assert_close(compiled(x), model(x), rtol=0, atol=1e-13)


class Last(torch.nn.Module):
    """The outputs of a sequence alone."""

    def __init__(self, cell: mt.MemoryCell) -> None:
        super().__init__()
        self.sequence = mt.MemorySequence(cell)

    def forward(self, x: Tensor) -> Tensor:
        return self.sequence(x)[0]
