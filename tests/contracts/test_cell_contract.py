"""What the cell must do under every attention with every key rule."""

from __future__ import annotations

import io

import pytest
import torch
from torch import Tensor
from torch.func import functional_call, stack_module_state, vmap

import mann_torch as mt
from mann_torch.memory import KEY_RULES
from mann_torch.trees import map_tensors
from tests.conftest import make_attention, randn
from tests.contracts.test_memory_contract import ATTENTION_NAMES

B, S, N, WIDTH = 6, 4, 7, 3
#: Graphs that differ most; `make check` compiles them all.
QUICK = {
    ("soft", "representation"),
    ("reallocating_always", "state"),
}


#: Options by name, as they stand after a key rule: "state/default".
OPTIONS: dict[str, dict[str, object]] = {
    "": {"inertia": False, "directions": False, "writing": "attended", "write_gain": 0.75},
    "default": {},
    "inertia": {"inertia": True, "clock": False, "writing": "attended", "directions": False},
    "clock": {"inertia": False, "clock": True, "writing": "attended", "directions": False},
    "next": {"inertia": False, "clock": False, "writing": "next", "directions": False},
    "directions": {"inertia": False, "clock": False, "writing": "attended"},
}
#: Every attention with every key rule under the paper's law with a clock, and every option.
CELLS = [(a, r) for a in ATTENTION_NAMES for r in KEY_RULES]
CELLS += [(a, "state/default") for a in ("soft", "hard", "reallocating_always", "relaxed_hard")]
CELLS += [("soft", "representation/default"), *(("soft", f"state/{o}") for o in list(OPTIONS)[2:])]
cells = pytest.mark.parametrize(("attention", "rule"), CELLS)


def make_cell(attention: str, rule: str, seed: int = 0) -> mt.MemoryCell:
    torch.manual_seed(seed)
    name, _, chosen = rule.partition("/")
    options = {"context_size": 2, "output_size": 2, "clock": True, **OPTIONS[chosen]}
    return mt.MemoryCell(WIDTH, N, S, make_attention(attention), KEY_RULES[name](), **options)


def flows(cell: mt.MemoryCell) -> bool:
    """Whether the cell is a term of an ODE too."""
    return cell.inertia is None and cell.writing == "attended"


def stream(*batch: int, steps: int = 4, dtype: torch.dtype = torch.float32) -> Tensor:
    return (3.0 * randn(steps, *batch, WIDTH)).to(dtype)


def run(cell: mt.MemoryCell, x: Tensor) -> tuple[Tensor, mt.CellState]:
    return mt.MemorySequence(cell, engine="torch")(x)


def somewhere(cell: mt.MemoryCell) -> mt.CellState:
    """A state in use: contents apart, every slot active."""
    state = cell.initial_state((B,))
    mu = state.mu + (0.3 * randn(*state.mu.shape)).to(cell.dtype)
    keys = state.keys + randn(*state.keys.shape).to(cell.dtype)
    return state._replace(mu=mu, keys=keys, active=torch.ones_like(state.active))


@cells
def test_batch_equals_single_calls(attention: str, rule: str) -> None:
    cell = make_cell(attention, rule).double()
    x = stream(B, dtype=torch.float64)
    outputs, state = run(cell, x)
    for i in range(B):
        alone, last = run(cell, x[:, i])
        torch.testing.assert_close(alone, outputs[:, i], rtol=0, atol=1e-12)
        for mine, theirs in zip(last, state, strict=True):
            torch.testing.assert_close(mine, theirs[i], rtol=0, atol=1e-12)


@cells
def test_slot_permutation_permutes_the_state_and_not_the_output(attention: str, rule: str) -> None:
    cell = make_cell(attention, rule).double()
    state, x, order = somewhere(cell), stream(B, dtype=torch.float64)[0], torch.tensor([2, 0, 3, 1])
    shuffled = state._replace(mu=state.mu[:, order], keys=state.keys[:, order])
    if cell.writing == "next":
        shuffled = shuffled._replace(next=order.argsort()[state.next])
    (output, after), (other, after_other) = cell(x, state), cell(x, shuffled)
    torch.testing.assert_close(other, output, rtol=0, atol=1e-13)
    torch.testing.assert_close(after_other.mu, after.mu[:, order], rtol=0, atol=1e-13)
    torch.testing.assert_close(after_other.keys, after.keys[:, order], rtol=0, atol=1e-13)


def parameters_with_a_path(cell: mt.MemoryCell) -> set[str]:
    """Contents always have one; keys, T and theta only where weights answer smoothly."""
    names = ["features" if cell.inertia is not None else "features.0", "output"]
    names += ["clock"] if cell.clock is not None else []
    found = {f"{layer}.{leaf}" for layer in names for leaf in BOTH}
    found |= {"slots", "dt", "memory.write_gain"}
    if cell.inertia is not None:
        found |= {f"inertia.{name}" for name, _ in cell.inertia.named_parameters()}
        found |= {"mix.weight"} | ({"clock_feedback.weight"} if cell.clock is not None else set())
    if cell.memory.attention.switches:
        return found
    if cell.slot_keys.numel():
        found |= {"slot_keys"} | {f"context.{name}" for name, _ in cell.context.named_parameters()}
        found |= {f"memory.key_rule.{name}" for name in cell.memory.key_rule.constants()}
    return found | {f"memory.attention.{name}" for name in cell.memory.attention.constants()}


BOTH = ("weight", "bias")


@cells
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


@cells
def test_the_ode_form_is_there_or_refused_by_name(attention: str, rule: str) -> None:
    cell, x = make_cell(attention, rule), stream(B)[0]
    for ask in (cell.flow, cell.jump, cell.d_memory):
        if flows(cell):
            ask(x, cell.initial_state(B))
        else:
            with pytest.raises(mt.ConfigError, match=r"MemoryCell\.paper"):
                ask(x, cell.initial_state(B))


@cells
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


@pytest.mark.parametrize(
    ("attention", "rule"),
    [pair if pair in QUICK else pytest.param(*pair, marks=pytest.mark.slow) for pair in CELLS],
)
def test_one_step_compiles_with_parity(attention: str, rule: str) -> None:
    cell, x = make_cell(attention, rule), stream(B)
    torch._dynamo.reset()
    compiled = torch.compile(cell, backend="aot_eager", fullgraph=True)
    state = other = cell.initial_state((B,))
    for now in x:
        (output, state), (theirs, other) = cell(now, state), compiled(now, other)
        torch.testing.assert_close(theirs, output, rtol=0, atol=1e-6)
    for mine, their in zip(state, other, strict=True):
        torch.testing.assert_close(their, mine, rtol=0, atol=1e-12)


@cells
def test_one_step_exports_for_any_batch_saves_and_loads_with_parity(
    attention: str, rule: str
) -> None:
    cell, batch = make_cell(attention, rule), {0: torch.export.Dim("batch")}
    arguments = (stream(B)[0], cell.initial_state(B))
    shapes = (batch, mt.CellState(*[batch] * len(mt.CellState._fields)))
    file = io.BytesIO()
    torch.export.save(torch.export.export(cell, arguments, dynamic_shapes=shapes), file)
    file.seek(0)
    loaded = torch.export.load(file).module()
    state = other = cell.initial_state(11)
    for now in stream(11):
        (output, state), (theirs, other) = cell(now, state), loaded(now, other)
        torch.testing.assert_close(theirs, output, rtol=0, atol=1e-6)
    for mine, their in zip(state, other, strict=True):
        torch.testing.assert_close(their, mine, rtol=0, atol=1e-12)


@cells
def test_a_step_keeps_nothing_in_the_module(attention: str, rule: str) -> None:
    cell = make_cell(attention, rule)
    before = [{name: id(value) for name, value in vars(m).items()} for m in cell.modules()]
    values = {name: tensor.clone() for name, tensor in cell.state_dict().items()}
    state = run(cell, stream(B))[1]
    if flows(cell):
        cell.jump(stream(B)[0], state)
    assert before == [{name: id(v) for name, v in vars(m).items()} for m in cell.modules()]
    assert all(torch.equal(tensor, values[name]) for name, tensor in cell.state_dict().items())


@cells
def test_a_state_is_detached_saved_and_loaded_whole(attention: str, rule: str) -> None:
    cell, x = make_cell(attention, rule), stream(B)
    state = run(cell, x)[1]
    assert state.mu.requires_grad
    assert not any(leaf.requires_grad for leaf in state.detach())
    file = io.BytesIO()
    torch.save(state, file)
    file.seek(0)
    again = torch.load(file)  # weights_only
    assert isinstance(again, mt.CellState)
    assert torch.equal(cell(x[0], again)[0], cell(x[0], state)[0])


@cells
def test_gradients_over_a_long_sequence_are_finite(attention: str, rule: str) -> None:
    cell = make_cell(attention, rule)
    cell.tune(*cell.constants())
    outputs, _ = run(cell, stream(2, steps=120))
    outputs.square().mean().backward()
    for name, parameter in cell.named_parameters():
        assert parameter.grad is None or bool(torch.isfinite(parameter.grad).all()), name


@cells
def test_vmap_over_parameters_equals_a_loop(attention: str, rule: str) -> None:
    sequences = [
        mt.MemorySequence(make_cell(attention, rule, seed), engine="torch") for seed in range(3)
    ]
    x = stream(B)
    parameters, buffers = stack_module_state(sequences)

    def one(parameters: dict[str, Tensor], buffers: dict[str, Tensor]) -> Tensor:
        return functional_call(sequences[0], (parameters, buffers), (x,))[0]

    together = vmap(one)(parameters, buffers)
    for sequence, outputs in zip(sequences, together, strict=True):
        torch.testing.assert_close(outputs, sequence(x)[0], rtol=0, atol=1e-6)
