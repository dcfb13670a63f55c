"""The cell over a sequence, and what it leaves for telemetry."""

from __future__ import annotations

import pytest
import torch
from torch import nn

import mann_torch as mt
from tests.conftest import randn
from tests.memory.cells import WIDTH, N, S, make_cell


def test_it_is_called_as_an_lstm_is() -> None:
    cell, lstm = mt.MemoryCell(10, 20, 5), nn.LSTM(10, 20, batch_first=True)
    x = torch.randn(4, 7, 10)
    outputs, state = mt.MemorySequence(cell, batch_first=True)(x)
    assert outputs.shape == lstm(x)[0].shape and outputs.dtype == x.dtype
    again, _ = mt.MemorySequence(cell)(x.transpose(0, 1), cell.initial_state(4))
    assert torch.equal(again.transpose(0, 1), outputs)
    assert state.mu.shape == (4, 5, 20)


def test_in_two_pieces_a_sequence_gives_the_same() -> None:
    sequence, x = mt.MemorySequence(make_cell("reallocating_always")), 3 * randn(12, 2, WIDTH)
    whole, last = sequence(x)
    first, state = sequence(x[:5])
    second, end = sequence(x[5:], state)
    assert torch.equal(torch.cat([first, second]), whole)
    assert all(torch.equal(a, b) for a, b in zip(end, last, strict=True))


def test_gradients_over_a_long_sequence_are_finite_and_detach_cuts_them() -> None:
    cell = make_cell("soft", output_size=1)
    first = randn(2, WIDTH).requires_grad_()
    outputs, state = mt.MemorySequence(cell)(torch.cat([first[None], randn(1500, 2, WIDTH)]))
    (slope,) = torch.autograd.grad(outputs.sum(), first)
    assert bool(torch.isfinite(slope).all()) and bool((slope != 0).any())
    assert state.mu.requires_grad and not state.detach().mu.requires_grad
    assert isinstance(state.detach(), mt.CellState)


def test_trace_logs_what_a_member_did() -> None:
    sequence, x = (
        mt.MemorySequence(make_cell("reallocating_always"), engine="torch"),
        4 * randn(60, 3, WIDTH),
    )
    trace = sequence.trace(x)
    outputs, state = sequence(x)
    assert torch.equal(trace.read, outputs.detach()) and torch.equal(trace.mu[-1], state.mu)
    log = mt.memory.reallocation_log(trace, 1)
    assert len(log["step"]) == int(state.reallocations[1]) > 0
    run = trace.member(1)
    assert run["mu"].shape == (60, S, N) and run["weights"].shape == (60, S)
    assert (run["weights"][log["step"], log["slot"]] == 1).all()
    resumed = sequence.trace(x[30:], sequence(x[:30])[1].detach())
    later = mt.memory.reallocation_log(resumed, 1)
    for name, shift in (("step", 30), ("slot", 0)):
        whole = log[name][log["step"] >= 30]
        assert (later[name] + shift == whole).all() and len(later[name]) == len(whole) > 0


def test_the_log_names_the_slot_that_was_reset_where_another_is_attended() -> None:
    cell = make_cell("reallocating_always", key_rule=mt.StateKeys())
    x = 4 * randn(WIDTH)
    start = cell.initial_state()
    keys = x.expand(S, WIDTH)  # every key as near as a fresh one: slot 0 stays attended
    start = start._replace(keys=keys, active=torch.ones(S, dtype=torch.bool))
    trace = mt.MemorySequence(cell).trace(x.unsqueeze(0), start)
    farthest = (cell.features(x) - start.mu / 0.75).abs().amax(-1).argmax()
    assert int(trace.attended[0]) == 0 != int(farthest)
    assert mt.memory.reallocation_log(trace)["slot"].tolist() == [int(farthest)]


def test_a_sequence_takes_a_step_length_for_each_sample() -> None:
    sequence, x = mt.MemorySequence(make_cell(), True, "torch"), randn(3, 5, WIDTH)
    dt = torch.rand(3, 5, dtype=torch.float64)
    dt[0, 2:] = 0.0  # a shorter sequence in the batch
    outputs, state = sequence(x, dt=dt)
    alone, last = sequence(x[:1, :2], dt=dt[:1, :2])
    torch.testing.assert_close(outputs[:1, :2], alone, rtol=0, atol=1e-15)
    torch.testing.assert_close(state.mu[:1], last.mu, rtol=0, atol=1e-15)
    assert torch.equal(sequence.trace(x, dt=dt).mu[-1], state.mu)
    for wrong in (dt[:, 1:], torch.tensor(1.0)):
        with pytest.raises(mt.ShapeError, match=r"dt has shape .*\(B, T\)"):
            sequence(x, dt=wrong)


@pytest.mark.parametrize("name", ["hard", "reallocating_initial"])
def test_a_trace_starts_where_it_is_told_and_records_every_count(name: str) -> None:
    sequence = mt.MemorySequence(make_cell(name, key_rule=mt.StateKeys(0.3)), True, "torch")
    x = 4 * randn(2, 40, WIDTH)
    _, state = sequence(x[:, :1])
    trace = sequence.trace(x[:, 1:], state.detach())
    later = state
    for step in range(39):
        _, later = sequence.cell(x[:, 1 + step], later)
        for leaf in ("active", "attended", "switches", "reallocations"):
            assert torch.equal(getattr(trace, leaf)[step], getattr(later, leaf)), leaf
        for leaf in ("mu", "keys"):  # features of all steps at once: sums in another order
            mine, theirs = getattr(trace, leaf)[step], getattr(later, leaf).detach()
            torch.testing.assert_close(mine, theirs, rtol=0, atol=1e-14)
    assert bool((trace.switches[-1] > trace.switches[0]).all())
    assert sequence.trace(x[:, 1:]).mu.shape == (39, 2, S, N)


def test_a_member_that_is_not_there_is_named() -> None:
    trace = mt.MemorySequence(make_cell()).trace(randn(5, 2, WIDTH))
    one_each, outside = "give one index each", r"a batch of \(2,\): out of range"
    for index, said in (((), one_each), ((2,), outside), ((-3,), outside), ((0, 0), one_each)):
        with pytest.raises(mt.ShapeError, match=said):
            trace.member(*index)
        with pytest.raises(mt.ShapeError, match=said):
            mt.memory.reallocation_log(trace, *index)


def test_without_a_batch_it_takes_rows_of_time_as_an_lstm_does() -> None:
    cell, x = make_cell(), randn(7, WIDTH)
    first = mt.MemorySequence(cell, batch_first=True)(x)[0]
    assert torch.equal(first, mt.MemorySequence(cell)(x)[0])
    with pytest.raises(mt.ShapeError, match="a sequence is"):
        mt.MemorySequence(cell)(x[0])
    with pytest.raises(mt.ShapeError, match="at least one step"):
        mt.MemorySequence(cell)(x[:0])
    with pytest.raises(mt.ConfigError, match="MemoryCell"):
        mt.MemorySequence(nn.LSTMCell(3, 4))
    with pytest.raises(mt.KindError, match=r"cell = 3: must be .*MemoryLayers\(3, 8\) takes sizes"):
        mt.MemorySequence(3, 8)


@pytest.mark.parametrize("name", ["reallocating_always", "default"])
def test_a_trace_takes_the_marks_that_a_call_takes(name: str) -> None:
    torch.manual_seed(0)
    cell = mt.MemoryCell(WIDTH, N, S, dtype=torch.float64)
    cell = cell if name == "default" else make_cell(name)
    sequence, x, ends = (
        mt.MemorySequence(cell, engine="torch"),
        4 * randn(20, 3, WIDTH),
        [20, 7, 13],
    )
    reset, valid = torch.zeros(20, 3, dtype=torch.bool), torch.ones(20, 3, dtype=torch.bool)
    reset[9, 0], valid[4, 0] = True, False
    x[7:, 1], x[4, 0] = torch.nan, torch.nan
    marks = {"lengths": ends, "reset": reset, "valid": valid}
    outputs, last = sequence(x, **marks)
    trace = sequence.trace(x, **marks)
    if name != "default":  # what is read is the output
        assert torch.equal(trace.read, outputs.detach())
    for leaf in ("mu", "keys", "active", "attended", "switches", "reallocations"):
        assert torch.equal(getattr(trace, leaf)[-1], getattr(last, leaf).detach()), leaf
    for leaf in trace:
        assert bool(torch.isfinite(leaf).all())
    taken = valid & (torch.arange(20).unsqueeze(-1) < torch.tensor(ends))
    assert torch.equal(trace.valid, taken) and int(taken.sum()) == 39
    assert bool((trace.weights.sum(-1)[taken] > 0.99).all())
    assert not trace.weights[~taken].any() and not trace.read[~taken].any()
    assert bool((trace.reset[~taken] == -1).all())
    assert torch.equal(trace.mu[4, 0], trace.mu[3, 0])  # stands still
    assert torch.equal(trace.mu[7:, 1], trace.mu[6, 1].expand_as(trace.mu[7:, 1]))
    fresh = sequence.trace(x[9:, :1])
    torch.testing.assert_close(trace.mu[9:, :1], fresh.mu, rtol=0, atol=1e-13)
    assert torch.equal(trace.reset[9:, :1], fresh.reset)
    turned = mt.MemorySequence(cell, True, "torch").trace(
        x.transpose(0, 1), lengths=ends, reset=reset.T, valid=valid.T
    )
    assert all(torch.equal(a, b) for a, b in zip(turned, trace, strict=True))
    packed = nn.utils.rnn.pack_padded_sequence(x, torch.tensor(ends), enforce_sorted=False)
    again = sequence.trace(packed, reset=reset, valid=valid)
    assert all(torch.equal(a, b) for a, b in zip(again, trace, strict=True))


@pytest.mark.parametrize("engine", ["auto", "compiled", "torch"])
def test_a_batch_without_a_sample_gives_none(engine: str) -> None:
    cell = make_cell("reallocating_always")
    sequence, x = mt.MemorySequence(cell, engine=engine), randn(5, 0, WIDTH).requires_grad_()
    outputs, state = sequence(x, lengths=[])
    assert outputs.shape == (5, 0, N) and state.mu.shape == (0, S, N)
    outputs.sum().backward()
    assert x.grad is not None and x.grad.shape == x.shape
    assert sequence.trace(x).mu.shape == (5, 0, S, N)
    assert sequence(randn(5, 2, WIDTH))[0].shape == (5, 2, N)
    layers = mt.MemoryLayers(WIDTH, N, 2, engine=engine, dtype=torch.float64)
    assert layers(x)[0].shape == (5, 0, N)
