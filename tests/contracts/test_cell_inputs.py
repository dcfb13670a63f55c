"""What a cell takes and refuses, under every attention with every key rule."""

from __future__ import annotations

import pytest
import torch
from torch import Tensor

import mann_torch as mt
from tests.conftest import randn
from tests.contracts.test_cell_contract import (
    WIDTH,
    B,
    N,
    S,
    cells,
    flows,
    make_cell,
    run,
    somewhere,
    stream,
)


def same(one: mt.CellState, other: mt.CellState) -> None:
    for mine, theirs in zip(one, other, strict=True):
        torch.testing.assert_close(mine, theirs, rtol=0, atol=1e-12)


@cells
def test_fewer_dimensions_of_x_or_state_mean_the_same_for_all(attention: str, rule: str) -> None:
    cell = make_cell(attention, rule).double()
    state, x = somewhere(cell), stream(B, dtype=torch.float64)
    active = torch.rand(B, S) < 0.6
    active[:, 0] = True
    state = state._replace(active=active.to(state.active.dtype))
    for now in x[:, 0]:
        same(cell(now, state)[1], cell(now.expand(B, -1), state)[1])
        if flows(cell):
            same(cell.jump(now, state), cell.jump(now.expand(B, -1), state))
    one = mt.CellState(*(leaf[0] for leaf in state))
    every = mt.CellState(*(leaf[:1].expand(B, *leaf.shape[1:]) for leaf in state))
    output, after = cell(x[0], one)
    expected, all_after = cell(x[0], every)
    torch.testing.assert_close(output, expected, rtol=0, atol=1e-12)
    same(after, all_after)
    assert {leaf.shape[0] for leaf in after} == {B}


@cells
def test_a_constant_a_sample_is_a_batch_of_cells(attention: str, rule: str) -> None:
    cell = make_cell(attention, rule).double()
    x, gains = stream(dtype=torch.float64), [0.4, 0.9]
    cell.initialize(write_gain=gains)
    outputs, state = run(cell, x)
    for i, gain in enumerate(gains):
        cell.initialize(write_gain=gain)
        alone, last = run(cell, x)
        torch.testing.assert_close(outputs[:, i], alone, rtol=0, atol=1e-12)
        same(mt.CellState(*(leaf[i] for leaf in state)), last)


def bad_states(state: mt.CellState) -> dict[str, mt.CellState]:
    """States that do not fit, by the leaf that their error must name."""
    return {
        "state.mu has shape": state._replace(mu=state.mu[..., 1:]),
        "state.keys has shape": state._replace(keys=state.keys[..., :1, :]),
        "state.active has shape": state._replace(active=state.active[..., 1:]),
        "state.keys": state._replace(keys=state.keys[1:]),
        "state.attended": state._replace(attended=state.attended[:, None]),
        "state.switches": state._replace(switches=state.switches[1:]),
    }


@cells
def test_wrong_shapes_are_named(attention: str, rule: str) -> None:
    cell = make_cell(attention, rule)
    state, x = cell.initial_state((B,)), stream(B)[0]
    for words, wrong in bad_states(state).items():
        with pytest.raises(mt.ShapeError, match=words):
            cell(x, wrong)
    with pytest.raises(mt.ShapeError, match="x has shape"):
        cell(x[:, 1:], state)
    with pytest.raises(mt.ShapeError, match=r"batch shapes do not fit: x \(5,\), state \(6,\)"):
        cell(x[1:], state)
    for shape in ((B, 1), (7, B), (B + 1,)):
        with pytest.raises(mt.ShapeError, match="batch shapes do not fit: dt"):
            cell(x, state, dt=torch.ones(shape))
    for shape in ((7, 1, N), (B + 1, N), (2, N)):
        with pytest.raises(mt.ShapeError, match="batch shapes do not fit: correction"):
            cell(x, state, correction=torch.zeros(shape))
        if flows(cell):
            with pytest.raises(mt.ShapeError, match="batch shapes do not fit: correction"):
                cell.flow(x, state, correction=torch.zeros(shape))
    with pytest.raises(mt.ShapeError, match="correction has shape"):
        cell(x, state, correction=torch.zeros(B, N + 1))


@cells
def test_wrong_dtypes_and_kinds_are_named(attention: str, rule: str) -> None:
    cell = make_cell(attention, rule)
    state, x = cell.initial_state((B,)), stream(B)[0]
    with pytest.raises(mt.DtypeError, match=r"this cell takes torch\.float32"):
        cell(x.double(), state)
    other = torch.int64 if state.active.dtype == torch.bool else torch.bool
    for name, kind in (
        ("mu", torch.float64),
        ("keys", torch.float64),
        ("active", other),
        ("attended", torch.float64),
    ):
        wrong = state._replace(**{name: getattr(state, name).to(kind)})
        with pytest.raises(mt.DtypeError, match=f"state.{name} is {kind}"):
            cell(x, wrong)
    with pytest.raises(mt.ConfigError, match="initial_state"):
        cell(x, (state.mu, state.keys))
    for wrong_x in ([0.0] * WIDTH, x.numpy(), None):
        with pytest.raises(mt.DtypeError, match="not a tensor"):
            cell(wrong_x, state)
        with pytest.raises(mt.DtypeError, match="not a tensor"):
            cell(wrong_x)
    with pytest.raises(mt.DtypeError, match="dt is"):
        cell(x, state, dt=torch.ones(B, dtype=torch.int64))


@cells
def test_without_a_state_it_starts_from_the_initial_one(attention: str, rule: str) -> None:
    cell, x = make_cell(attention, rule), stream(2, 3)[0]
    output, state = cell(x)
    expected, after = cell(x, cell.initial_state((2, 3)))
    assert torch.equal(output, expected)
    same(state, after)


def test_the_papers_start_compiles() -> None:
    cell, x = make_cell("reallocating_always", "state").double(), stream(B).double()[0]
    torch._dynamo.reset()
    compiled = torch.compile(cell.initial_state_at, backend="aot_eager", fullgraph=True)
    same(compiled(x), cell.initial_state_at(x))


@cells
def test_the_papers_start_maps_over_rows(attention: str, rule: str) -> None:
    cell, x = make_cell(attention, rule).double(), stream(B, dtype=torch.float64)[0]

    def start(row: Tensor) -> tuple[Tensor, ...]:
        return tuple(cell.initial_state_at(row).memory)

    mapped = torch.func.vmap(start)(x)
    for mine, theirs in zip(cell.initial_state_at(x).memory, mapped, strict=True):
        torch.testing.assert_close(theirs, mine, rtol=0, atol=1e-12)


@pytest.mark.parametrize("shape", [-1, 2.0, (2, -3), "two", None])
def test_a_batch_shape_that_is_none_is_named(shape: object) -> None:
    with pytest.raises(mt.ConfigError, match="batch_shape"):
        make_cell("soft", "state").initial_state(shape)
    assert make_cell("soft", "state").initial_state(torch.Size([2])).mu.shape == (2, S, N)


def test_autocast_lets_a_layer_of_any_precision_lead_into_the_cell() -> None:
    cell, layer = make_cell("soft", "state"), torch.nn.Linear(WIDTH, WIDTH)
    with torch.autocast("cpu", torch.bfloat16):
        output, _ = cell(layer(randn(B, WIDTH).float()), cell.initial_state(B))
    assert output.dtype == torch.float32 and bool(torch.isfinite(output).all())
