"""What the cell must do under every attention with every key rule."""

from __future__ import annotations

import pytest
import torch
from torch import Tensor
from torch.func import functional_call, stack_module_state, vmap

import mann_torch as mt
from mann_torch.memory import KEY_RULES
from mann_torch.trees import map_tensors
from tests.conftest import make_attention, randn
from tests.contracts.test_memory_contract import pairs

B, S, N, WIDTH = 6, 4, 7, 3


def make_cell(attention: str, rule: str, seed: int = 0) -> mt.MemoryCell:
    torch.manual_seed(seed)
    kind = make_attention(attention)
    options = {"context_size": 2, "output_size": 2, "clock": True}
    return mt.MemoryCell(WIDTH, N, S, kind, KEY_RULES[rule](), **options)


def stream(*batch: int, steps: int = 4, dtype: torch.dtype = torch.float32) -> Tensor:
    return (3.0 * randn(steps, *batch, WIDTH)).to(dtype)


def run(cell: mt.MemoryCell, x: Tensor) -> tuple[Tensor, mt.CellState]:
    return mt.MemorySequence(cell)(x)


def somewhere(cell: mt.MemoryCell) -> mt.CellState:
    """A state in use: contents apart, every slot active."""
    state = cell.initial_state((B,))
    mu, keys = state.mu + 0.3 * randn(*state.mu.shape), state.keys + randn(*state.keys.shape)
    return state._replace(mu=mu, keys=keys, active=torch.ones_like(state.active))


@pairs
def test_batch_equals_single_calls(attention: str, rule: str) -> None:
    cell = make_cell(attention, rule).double()
    x = stream(B, dtype=torch.float64)
    outputs, state = run(cell, x)
    for i in range(B):
        alone, last = run(cell, x[:, i])
        torch.testing.assert_close(alone, outputs[:, i], rtol=0, atol=1e-12)
        for mine, theirs in zip(last, state, strict=True):
            torch.testing.assert_close(mine, theirs[i], rtol=0, atol=1e-12)


@pairs
def test_slot_permutation_permutes_the_state_and_not_the_output(attention: str, rule: str) -> None:
    cell = make_cell(attention, rule).double()
    state, x, order = somewhere(cell), stream(B, dtype=torch.float64)[0], torch.tensor([2, 0, 3, 1])
    shuffled = state._replace(mu=state.mu[:, order], keys=state.keys[:, order])
    (output, after), (other, after_other) = cell(x, state), cell(x, shuffled)
    torch.testing.assert_close(other, output, rtol=0, atol=1e-13)
    torch.testing.assert_close(after_other.mu, after.mu[:, order], rtol=0, atol=1e-13)
    torch.testing.assert_close(after_other.keys, after.keys[:, order], rtol=0, atol=1e-13)


def parameters_with_a_path(cell: mt.MemoryCell) -> set[str]:
    """Contents always have one; keys, T and theta only where weights answer smoothly."""
    layers = {f"{layer}.{leaf}" for layer in ("features.0", "output", "clock") for leaf in BOTH}
    found = layers | {"slots", "dt", "memory.write_gain"}
    if cell.memory.attention.switches:
        return found
    if cell.slot_keys.numel():
        found |= {"slot_keys", "context.weight", "context.bias"}
        found |= {f"memory.key_rule.{name}" for name in cell.memory.key_rule.constants()}
    return found | {f"memory.attention.{name}" for name in cell.memory.attention.constants()}


BOTH = ("weight", "bias")


@pairs
def test_gradients_reach_exactly_the_parameters_with_a_path(attention: str, rule: str) -> None:
    cell = make_cell(attention, rule)
    if "temperature" in cell.constants():
        cell.initialize(temperature=1.0)
    cell.tune(*cell.constants())
    outputs, state = run(cell, stream(B))
    (outputs.square().sum() + state.mu.square().sum()).backward()
    reached = set()
    for name, parameter in cell.named_parameters():
        if parameter.grad is not None and bool((parameter.grad != 0).any()):
            assert bool(torch.isfinite(parameter.grad).all()), name
            reached.add(name)
    assert reached == parameters_with_a_path(cell)


@pairs
def test_state_dict_round_trip(attention: str, rule: str) -> None:
    cell, twin, x = make_cell(attention, rule), make_cell(attention, rule, seed=1), stream(B)
    cell.initialize(dt=0.3)
    before = run(cell, x)[0]
    assert not torch.equal(run(twin, x)[0], before)
    twin.load_state_dict(cell.state_dict())
    assert torch.equal(run(twin, x)[0], before)
    state = run(cell, x)[1]
    cell.memory.store_(map_tensors(lambda leaf: leaf[0], state.memory), state.active[0])
    twin.load_state_dict(cell.state_dict())
    assert torch.equal(twin.initial_state().mu, state.mu[0])


@pairs
def test_one_step_exports_and_compiles_with_parity(attention: str, rule: str) -> None:
    cell, x = make_cell(attention, rule), stream(B)
    exported = torch.export.export(cell, (x[0], cell.initial_state(B))).module()
    torch._dynamo.reset()
    compiled = torch.compile(cell, backend="aot_eager", fullgraph=True)
    state = other = third = cell.initial_state((B,))
    for now in x:
        (output, state), (theirs, other) = cell(now, state), exported(now, other)
        compiled_output, third = compiled(now, third)
        torch.testing.assert_close(theirs, output, rtol=0, atol=1e-6)
        torch.testing.assert_close(compiled_output, output, rtol=0, atol=1e-6)
    for mine, theirs, again in zip(state, other, third, strict=True):
        torch.testing.assert_close(theirs, mine, rtol=0, atol=1e-12)
        torch.testing.assert_close(again, mine, rtol=0, atol=1e-12)


@pairs
def test_vmap_over_parameters_equals_a_loop(attention: str, rule: str) -> None:
    sequences = [mt.MemorySequence(make_cell(attention, rule, seed)) for seed in range(3)]
    x = stream(B)
    parameters, buffers = stack_module_state(sequences)

    def one(parameters: dict[str, Tensor], buffers: dict[str, Tensor]) -> Tensor:
        return functional_call(sequences[0], (parameters, buffers), (x,))[0]

    together = vmap(one)(parameters, buffers)
    for sequence, outputs in zip(sequences, together, strict=True):
        torch.testing.assert_close(outputs, sequence(x)[0], rtol=0, atol=1e-6)


@pairs
def test_wrong_shapes_and_dtypes_are_named_errors(attention: str, rule: str) -> None:
    cell = make_cell(attention, rule)
    state, x = cell.initial_state((B,)), stream(B)[0]
    with pytest.raises(mt.DtypeError, match=r"this cell takes torch\.float32"):
        cell(x.double(), state)
    with pytest.raises(mt.DtypeError, match="always float64"):
        cell(x, state._replace(mu=state.mu.float()))
    with pytest.raises(mt.ShapeError, match="x has shape"):
        cell(x[:, 1:], state)
    with pytest.raises(mt.ShapeError, match="batch shapes"):
        cell(x[1:], state)
    with pytest.raises(mt.ShapeError, match="mu has shape"):
        cell(x, state._replace(mu=state.mu[..., 1:]))
    with pytest.raises(mt.ShapeError, match="correction has shape"):
        cell(x, state, correction=torch.zeros(B, N + 1))
    with pytest.raises(mt.ConfigError, match="initial_state"):
        cell(x, (state.mu, state.keys))
    with pytest.raises(mt.ShapeError, match="a sequence is"):
        mt.MemorySequence(cell, batch_first=True)(x)
