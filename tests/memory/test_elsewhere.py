"""A cell on another device, and as an ONNX file."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import torch
from torch import Tensor, nn

import mann_torch as mt
from tests.conftest import make_attention

CELLS = {
    "default": lambda: mt.MemoryCell(3, 6, 4, output_size=2),
    "hard": lambda: mt.MemoryCell.paper(3, 6, 4, make_attention("hard")),
    "reallocating": lambda: mt.MemoryCell.paper(
        3, 6, 4, make_attention("reallocating_always"), mt.StateKeys()
    ),
}


@pytest.mark.parametrize("name", CELLS)
def test_nothing_of_a_step_stays_on_the_cpu(name: str) -> None:
    """On `meta`, which refuses, as any device does, to be mixed with another."""
    cell = CELLS[name]().to("meta")
    sequence, x = mt.MemorySequence(cell), torch.zeros(5, 2, 3, device="meta", requires_grad=True)
    marks = {"lengths": [5, 3], "reset": torch.zeros(5, 2, dtype=torch.bool, device="meta")}
    outputs, state = sequence(x, **marks)
    outputs.sum().backward()
    for found in (outputs, x.grad, *state, *sequence.trace(x, **marks), cell(x[0])[0]):
        assert found.device.type == "meta"
    assert sequence.taken(x) == ("torch", "there is no compiled engine on meta")
    with pytest.raises(mt.ConfigError, match="no compiled engine on meta"):
        mt.MemoryStream(cell)


class Step(nn.Module):
    """A step whose state goes in and out leaf by leaf."""

    def __init__(self, cell: mt.MemoryCell) -> None:
        super().__init__()
        self.cell = cell

    def forward(self, x: Tensor, *state: Tensor) -> tuple[Tensor, ...]:
        output, after = self.cell(x, mt.CellState(*state))
        return (output, *after)


class Outputs(nn.Module):
    """A sequence without its state."""

    def __init__(self, cell: mt.MemoryCell) -> None:
        super().__init__()
        self.sequence = mt.MemorySequence(cell)

    def forward(self, x: Tensor) -> tuple[Tensor]:
        return (self.sequence(x)[0],)


@pytest.mark.parametrize("kind", ["step", "sequence"])
def test_onnxruntime_gives_the_cells_numbers(kind: str, tmp_path: Path) -> None:
    runtime = pytest.importorskip("onnxruntime", reason="an extra: pip install mann_torch[deploy]")
    pytest.importorskip("onnxscript")
    torch.manual_seed(0)
    cell = CELLS["default"]()
    module, given = Outputs(cell), (torch.randn(4, 2, 3),)
    if kind == "step":
        _, state = cell(torch.randn(2, 3))
        module = Step(cell)
        given = (torch.randn(2, 3), *(x.contiguous() for x in state.detach()))
    path = tmp_path / "cell.onnx"
    torch.onnx.export(module.eval(), given, dynamo=True, verbose=False).save(path)
    session = runtime.InferenceSession(str(path))
    names = [row.name for row in session.get_inputs()]
    arrays = {n: x.numpy() for n, x in zip(names, given, strict=True)}
    expected = [x.detach().numpy() for x in module(*given)]
    for mine, theirs in zip(session.run(None, arrays), expected, strict=True):
        np.testing.assert_allclose(mine, theirs, rtol=0, atol=1e-6)
    assert np.abs(expected[0]).max() > 0.01
