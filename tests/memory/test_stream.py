"""A cell one step a call."""

from __future__ import annotations

import io

import numpy as np
import pytest
import torch

import mann_torch as mt
from tests.conftest import randn
from tests.memory.cells import WIDTH, make_cell


def default(**options: object) -> mt.MemoryCell:
    torch.manual_seed(0)
    return mt.MemoryCell(WIDTH, 6, 4, output_size=2, dtype=torch.float64, **options)


@pytest.mark.parametrize("batch", [(), (3,), (2, 10)])
def test_a_stream_gives_what_the_cell_gives(batch: tuple[int, ...]) -> None:
    cell = default()
    stream = mt.MemoryStream(cell, batch)
    state, other = stream.initial_state(), cell.initial_state(batch)
    for x in 2 * randn(12, *batch, WIDTH):
        output, state = stream(x, state)
        expected, other = cell(x, other)
        torch.testing.assert_close(output, expected.detach(), rtol=0, atol=1e-13)
    for mine, theirs in zip(stream.unpacked(state), other, strict=True):
        torch.testing.assert_close(mine, theirs.detach(), rtol=0, atol=1e-13)
    dt = torch.full(batch, 0.3, dtype=torch.float64)
    for given in (0.3, dt):
        expected = cell(x, other, dt=given)[1].mu.detach()
        found = stream.unpacked(stream(x, state, given)[1]).mu
        torch.testing.assert_close(found, expected, rtol=0, atol=1e-13)
    again = stream(x, state)[0]  # a step length is for its call alone
    torch.testing.assert_close(again, cell(x, other)[0].detach(), rtol=0, atol=1e-13)


def test_a_state_is_packed_saved_and_loaded_and_a_call_leaves_it_alone() -> None:
    cell, x = make_cell("reallocating_always"), 3 * randn(2, WIDTH)
    stream = mt.MemoryStream(cell, 2)
    _, state = stream(x, stream.packed(cell.initial_state(2)))
    kept, file = state.clone(), io.BytesIO()
    stream(x, state)
    assert torch.equal(state.view(torch.int64), kept.view(torch.int64))  # masks look like NaN
    torch.save(state, file)
    file.seek(0)
    assert torch.equal(stream(x, torch.load(file))[0], stream(x, state)[0])
    for mine, theirs in zip(
        stream.unpacked(stream.packed(stream.unpacked(state))), stream.unpacked(state), strict=True
    ):
        assert torch.equal(mine, theirs)


def test_parameters_that_change_are_taken_up() -> None:
    cell, x = default(), randn(WIDTH)
    stream = mt.MemoryStream(cell)
    state = stream.initial_state()
    before = stream(x, state)[0]
    with torch.no_grad():
        for parameter in cell.parameters():
            parameter.mul_(1.1)
    after = stream(x, stream.initial_state())[0]
    assert not torch.equal(before, after)
    torch.testing.assert_close(after, cell(x)[0].detach(), rtol=0, atol=1e-13)
    twin = default()
    cell.load_state_dict(twin.state_dict())
    torch.testing.assert_close(stream(x, state)[0], before, rtol=0, atol=1e-15)


def test_what_does_not_fit_is_named() -> None:
    stream = mt.MemoryStream(default(), 2)
    x, state = randn(2, WIDTH), stream.initial_state()
    for wrong in (x[:1], x[:, 1:]):
        with pytest.raises(mt.ShapeError, match="x has shape"):
            stream(wrong, state)
    with pytest.raises(mt.ShapeError, match="state has shape"):
        stream(x, state[1:])
    remedy = r", this stream takes torch.float64: convert x, or the cell before a stream"
    for bad, words in ((x.float(), "x is torch.float32"), (x.long(), "x is torch.int64" + remedy)):
        with pytest.raises(mt.DtypeError, match=words):
            stream(bad, state)
    for other in (None, default().initial_state(2), state.numpy()):
        with pytest.raises(
            mt.KindError, match=r"state = .*initial_state\(\) gives .*packed\(...\)"
        ):
            stream(x, other)
    for call in (lambda: stream(x.numpy(), state), lambda: stream.begun(state, np.ones(2, bool))):
        with pytest.raises(mt.KindError, match=r"must be a Tensor, as torch\.as_tensor"):
            call()
    with pytest.raises(mt.ConfigError, match=r"batch_shape = \(2, 0\): a stream needs a sample"):
        mt.MemoryStream(default(), (2, 0))
    with pytest.raises(mt.DtypeError, match="state is"):
        stream(x, state.float())
    with pytest.raises(mt.ShapeError, match="dt"):
        stream(x, state, torch.ones(3, dtype=torch.float64))
    with pytest.raises(mt.ShapeError, match="batch shape"):
        stream.packed(default().initial_state(3))
    cell = default()
    cell.features.register_forward_hook(lambda *_: None)
    with pytest.raises(mt.ConfigError, match="hooks are not called"):
        mt.MemoryStream(cell)
    with pytest.raises(mt.ConfigError, match="MemoryCell"):
        mt.MemoryStream(torch.nn.LSTMCell(3, 4))
