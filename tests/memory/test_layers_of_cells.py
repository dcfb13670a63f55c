"""Layers with the manners of nn.LSTM: lengths, packing, depth, directions, dropout, resets."""

from __future__ import annotations

import copy
import pickle
from collections.abc import Sequence

import pytest
import torch
from torch import Tensor, nn
from torch.nn.utils.rnn import PackedSequence, pack_padded_sequence, pad_packed_sequence

import mann_torch as mt
from mann_torch.memory.sequences.lengths import valid_steps
from tests.conftest import randn

WIDTH, N, T = 3, 6, 9
LENGTHS = [4, 9, 1, 6]


def make(num_layers: int = 1, **options: object) -> mt.MemoryLayers:
    torch.manual_seed(0)
    given = {"n_slots": 4, "dtype": torch.float64, "engine": "torch", **options}
    return mt.MemoryLayers(WIDTH, N, num_layers, **given)


def close(one: Tensor, other: Tensor) -> None:
    torch.testing.assert_close(one, other, rtol=0, atol=1e-12)


def same(one: Sequence[mt.CellState], other: Sequence[mt.CellState], at: int) -> None:
    for mine, theirs in zip(one, other, strict=True):
        for a, b in zip(mine, theirs, strict=True):
            close(a[at].double(), b[0].double())


@pytest.mark.parametrize("engine", ["torch", pytest.param("compiled", marks=pytest.mark.slow)])
@pytest.mark.parametrize("options", [{}, {"num_layers": 2, "bidirectional": True}])
def test_padded_and_packed_give_the_numbers_of_one_sequence_at_a_time(
    engine: str, options: dict[str, object]
) -> None:
    layers = make(engine=engine, **options)
    x = randn(T, len(LENGTHS), WIDTH).requires_grad_()
    outputs, states = layers(x, lengths=LENGTHS)
    (slope,) = torch.autograd.grad(outputs.sin().sum(), x)
    packed = pack_padded_sequence(x, torch.tensor(LENGTHS), enforce_sorted=False)
    found, packed_states = layers(packed)
    assert isinstance(found, PackedSequence)
    assert torch.equal(found.batch_sizes, packed.batch_sizes)
    unpacked, lengths = pad_packed_sequence(found)
    assert lengths.tolist() == LENGTHS
    close(unpacked, outputs)
    total = torch.zeros_like(slope)
    for i, length in enumerate(LENGTHS):
        one = x[:length, i : i + 1]
        alone, last = layers(one)
        close(outputs[:length, i : i + 1], alone)
        assert not outputs[length:, i].any()
        same(states, last, i)
        same(packed_states, last, i)
        total += torch.autograd.grad(alone.sin().sum(), x)[0]
    close(slope, total)


def test_a_sequence_takes_lengths_and_packed_ones_too() -> None:
    cell = make().cells[0]
    sequence = mt.MemorySequence(cell, batch_first=True, engine="torch")
    x = randn(len(LENGTHS), T, WIDTH)
    outputs, state = sequence(x, lengths=torch.tensor(LENGTHS))
    for enforce in (False, True):
        order = torch.tensor([1, 3, 0, 2]) if enforce else torch.arange(4)
        packed = pack_padded_sequence(
            x[order], torch.tensor(LENGTHS)[order], batch_first=True, enforce_sorted=enforce
        )
        found, last = sequence(packed)
        close(pad_packed_sequence(found, batch_first=True)[0], outputs[order])
        close(last.mu, state.mu[order])
    valid = torch.rand(len(LENGTHS), T) < 0.7
    both, _ = sequence(x, lengths=LENGTHS, valid=valid)
    inside = torch.arange(T) < torch.tensor(LENGTHS).unsqueeze(-1)
    close(both, sequence(x, valid=valid & inside)[0])


@pytest.mark.parametrize("engine", ["torch", pytest.param("compiled", marks=pytest.mark.slow)])
@pytest.mark.parametrize("fill", [float("nan"), float("inf")])
def test_what_pads_reaches_nothing_not_even_a_gradient(engine: str, fill: float) -> None:
    layers, x, dt = make(2, engine=engine, bidirectional=True), randn(T, 4, WIDTH), randn(T, 4)
    outside = torch.arange(T).unsqueeze(-1) >= torch.tensor(LENGTHS)
    found = []
    for pad in (0.0, fill):
        padded = x.masked_fill(outside.unsqueeze(-1), pad).requires_grad_()
        outputs, states = layers(padded, dt=dt.abs().masked_fill(outside, pad), lengths=LENGTHS)
        used = [padded, *(p for p in layers.parameters() if p.requires_grad)]
        slopes = torch.autograd.grad(outputs.sin().sum(), used, materialize_grads=True)
        found.append([outputs, *(leaf for state in states for leaf in state), *slopes])
    assert all(torch.equal(clean, other) for clean, other in zip(*found, strict=True))
    assert not found[1][-len(used)][outside].any()


def test_marks_of_the_last_dimensions_are_meant_for_all_the_others() -> None:
    sequence, x = mt.MemorySequence(make().cells[0], engine="torch"), randn(T, 2, 3, WIDTH)
    valid, dt = torch.rand(T, 3) < 0.7, randn(T, 3).abs()
    found, _ = sequence(x, dt=dt, valid=valid)
    for i in range(2):
        close(found[:, i], sequence(x[:, i], dt=dt, valid=valid)[0])


def test_lengths_may_be_on_another_device_than_the_data() -> None:
    within = valid_steps(torch.tensor(LENGTHS), T, (4,), torch.device("meta"))
    assert within.device.type == "meta" and within.shape == (T, 4)


def test_it_is_called_as_an_lstm_is() -> None:
    layers = make(2, batch_first=True, bidirectional=True)
    lstm = nn.LSTM(WIDTH, N, 2, batch_first=True, bidirectional=True, dtype=torch.float64)
    x = randn(5, T, WIDTH)
    outputs, states = layers(x)
    assert outputs.shape == lstm(x)[0].shape and len(states) == len(lstm(x)[1][0]) == 4
    assert states[0].mu.shape == (5, 4, N)
    again, _ = layers(x, layers.initial_state(5))
    assert torch.equal(again, outputs)
    unbatched, _ = layers(x[0])
    close(unbatched, layers(x[:1])[0][0])
    first, middle = layers(x[:, :5], None)[1], make(2, batch_first=True)
    whole, last = middle(x)
    begun, state = middle(x[:, :4])
    ended, end = middle(x[:, 4:], state)
    close(torch.cat([begun, ended], 1), whole)
    assert all(torch.equal(a.next, b.next) for a, b in zip(last, end, strict=True))
    assert isinstance(first, tuple)


def test_a_backward_cell_is_a_forward_one_over_the_sequence_turned_round() -> None:
    layers, x = make(bidirectional=True), randn(T, 2, WIDTH)
    outputs, _ = layers(x)
    ahead, back = (mt.MemorySequence(cell, engine="torch") for cell in layers.cells)
    close(outputs[..., :N], ahead(x)[0])
    close(outputs[..., N:], back(x.flip(0))[0].flip(0))


def test_dropout_is_between_layers_in_training_alone() -> None:
    layers, x = make(2, dropout=0.5), randn(T, 50, WIDTH)
    inner = mt.MemorySequence(layers.cells[0], engine="torch")(x)[0]
    outer = mt.MemorySequence(layers.cells[1], engine="torch")
    torch.manual_seed(1)
    outputs, _ = layers(x)
    torch.manual_seed(1)
    close(outputs, outer(nn.functional.dropout(inner, 0.5))[0])
    layers.eval()
    close(layers(x)[0], outer(inner)[0])


def test_parts_are_copied_and_learn_apart() -> None:
    attention = mt.RelaxedAttention(0.5)
    layers = make(2, attention=attention, writing="next", output_size=2, return_state=False)
    held = [cell.memory.attention for cell in layers.cells]
    assert held[0] is not held[1] and attention not in held
    assert layers.cells[1].input_size == 2
    model = nn.Sequential(layers, nn.Linear(2, 1, dtype=torch.float64))
    x = randn(T, 2, WIDTH)
    model(x).sum().backward()
    twin = pickle.loads(pickle.dumps(copy.deepcopy(model)))
    assert torch.equal(twin(x), model(x))


@pytest.mark.parametrize("engine", ["torch", "compiled"])
def test_a_reset_is_a_fresh_start_bit_for_bit(engine: str) -> None:
    layers, x = make(2, engine=engine), randn(T, 3, WIDTH)
    reset = torch.zeros(T, 3, dtype=torch.bool)
    reset[4, 1] = True
    outputs, states = layers(x, reset=reset)
    fresh, last = layers(x[4:])
    plain, rest = layers(x)
    assert torch.equal(outputs[4:, 1], fresh[:, 1])
    assert torch.equal(outputs[:, [0, 2]], plain[:, [0, 2]])
    for found, began, went in zip(states, last, rest, strict=True):
        for a, b, c in zip(found, began, went, strict=True):
            assert torch.equal(a[1], b[1]) and torch.equal(a[[0, 2]], c[[0, 2]])


def test_what_does_not_fit_is_named() -> None:
    layers, x = make(), randn(T, 4, WIDTH)
    for lengths, kind, words in (
        ([4, 9, 1], mt.ShapeError, "lengths have shape"),
        ([4, 9, 1, 10], mt.ConfigError, "from 1 to 9"),
        ([4, 9, 0, 1], mt.ConfigError, "from 1 to 9"),
        ([4.0, 9.0, 1.0, 1.0], mt.DtypeError, "whole numbers"),
        ("four", mt.DtypeError, "whole numbers"),
    ):
        with pytest.raises(kind, match=words):
            layers(x, lengths=lengths)
    packed = pack_padded_sequence(x, torch.tensor([9, 4, 2, 1]))
    with pytest.raises(mt.ConfigError, match="its own"):
        layers(packed, lengths=[9, 4, 2, 1])
    with pytest.raises(mt.ConfigError, match="one a cell"):
        make(2)(x, layers.initial_state(4))
    with pytest.raises(mt.ConfigError, match="reset"):
        make(bidirectional=True)(x, reset=torch.zeros(T, dtype=torch.bool))
    with pytest.raises(mt.DtypeError, match="reset is"):
        layers(x, reset=torch.zeros(T))
    for dropout in (1.0, -0.1):
        with pytest.raises(mt.DomainError, match="dropout"):
            make(dropout=dropout)
    with pytest.raises(mt.ConfigError, match="features"):
        make(2, features=nn.Linear(WIDTH, N))


@pytest.mark.slow
def test_functional_call_and_autocast_give_the_same() -> None:
    layers, x = make(2, engine="auto"), randn(T, 2, WIDTH)
    parameters = dict(layers.named_parameters())
    found, _ = torch.func.functional_call(layers, parameters, (x,))
    close(found, layers(x)[0])
    single = make(2, dtype=torch.float32, engine="auto")
    with torch.autocast("cpu", torch.bfloat16):
        loose, _ = single(x.float())
    assert loose.dtype == torch.float32
    assert float((loose - single(x.float())[0]).detach().abs().max()) < 0.1


@pytest.mark.slow
def test_vmap_and_compile_give_the_same() -> None:
    layers, x = make(2, engine="auto", return_state=False), randn(3, 4, 2, WIDTH)
    each = torch.stack([layers(one) for one in x])
    close(torch.vmap(layers)(x), each)
    twins = [layers, make(2, engine="auto", return_state=False)]
    stacked = torch.func.stack_module_state(twins)
    several = torch.vmap(lambda p, b: torch.func.functional_call(layers, (p, b), (x[0],)))(*stacked)
    close(several, torch.stack([each[0], each[0]]))
    close(torch.compile(layers, backend="eager")(x[0]), each[0])


@pytest.mark.slow
def test_a_short_one_is_exported_and_loaded() -> None:
    layers, x = make(2, return_state=False), randn(4, 2, WIDTH)
    exported = torch.export.export(layers, (x,)).module()
    close(exported(x), layers(x))
