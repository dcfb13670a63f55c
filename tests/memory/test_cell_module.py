"""The cell as a module: dtype, device, optimizers, compiling, settings."""

from __future__ import annotations

import pytest
import torch
from torch import Tensor, nn

import mann_torch as mt
from tests.conftest import randn
from tests.memory.cells import WIDTH, N, S, make_cell


def test_dtype_is_that_of_parameters_state_and_arithmetic() -> None:
    torch.manual_seed(0)
    sequence = mt.MemorySequence(mt.MemoryCell(WIDTH, N))
    model = nn.Sequential(nn.Linear(WIDTH, WIDTH), sequence, Last())
    x = torch.randn(9, 2, WIDTH)
    model(x).sum().backward()
    rounded = model(x)
    cell = sequence.cell
    for ask, dtype in (
        (model.double, torch.float64),
        (model.float, torch.float32),
        (model.bfloat16, torch.bfloat16),
        (lambda: model.to("cpu"), torch.bfloat16),
    ):
        ask()
        assert model(x.to(dtype)).dtype == dtype == cell.dtype
        assert {p.dtype for p in (*cell.parameters(), cell.memory.initial_mu)} == {dtype}
        assert cell.initial_state().mu.dtype == dtype
    assert torch.allclose(model(x.bfloat16()).float(), rounded, atol=0.05)
    with pytest.raises(mt.DtypeError, match="floating"):
        mt.MemoryCell(WIDTH, N, dtype=torch.int64)


class Last(nn.Module):
    """The outputs of a sequence, without its state."""

    def forward(self, pair: tuple[Tensor, mt.CellState]) -> Tensor:
        return pair[0]


def test_one_optimizer_takes_float32_layers_and_the_cell_and_learns() -> None:
    torch.manual_seed(0)
    cell = mt.MemoryCell(WIDTH, 8, output_size=1)
    layer = nn.Linear(WIDTH, WIDTH)
    cell.tune("dt", "write_gain")
    parameters = [*layer.parameters(), *cell.parameters()]
    optimizer = torch.optim.Adam(parameters, lr=1e-2)
    x = torch.randn(20, 16, WIDTH)
    target = x.cumsum(0)[..., :1] / 20
    losses = []
    for _ in range(30):
        loss = (mt.MemorySequence(cell)(layer(x))[0] - target).square().mean()
        optimizer.zero_grad()
        loss.backward()
        nn.utils.clip_grad_norm_(parameters, 1.0)
        optimizer.step()
        losses.append(float(loss.detach()))
    assert losses[-1] < 0.8 * losses[0]
    assert float(cell.dt) != 1.0


def test_bad_settings_are_named() -> None:
    for options, name in (({"output_size": 0}, "output_size"), ({"context_size": 0}, "context")):
        with pytest.raises(mt.ConfigError, match=name):
            make_cell(**options)
    with pytest.raises(mt.DomainError, match="dt"):
        make_cell(dt=0.0)
    with pytest.raises(mt.ConfigError, match="input_size"):
        mt.MemoryCell(0, 3)
    for part in ("soft", mt.SoftAttention, mt.StateKeys()):
        with pytest.raises(mt.ConfigError, match="Attention"):
            mt.MemoryCell(WIDTH, N, S, part)
    for part in ("state", mt.StateKeys):
        with pytest.raises(mt.ConfigError, match="KeyRule"):
            make_cell(key_rule=part)
    with pytest.raises(mt.ConfigError, match=r"n_slots = 4\.5"):
        mt.MemoryCell(WIDTH, N, 4.5)
    with pytest.raises(mt.DtypeError, match="dtype"):
        mt.MemoryCell(WIDTH, N, dtype="float32")


def test_a_name_that_two_parts_use_is_refused_where_it_is_used() -> None:
    inner = make_cell(dt=2.0)
    features = nn.Sequential(nn.Linear(WIDTH, N), nn.Sigmoid())
    features.helper = inner
    cell = make_cell(features=features, dt=0.5)
    for ask in (cell.constants, lambda: cell.tune("dt"), lambda: cell.initialize(dt=1.0)):
        with pytest.raises(mt.ConfigError, match="'dt' is a design constant of MemoryCell, Memory"):
            ask()
    twin = make_cell(features=features, dt=0.1)
    twin.load_state_dict(cell.state_dict())
    assert float(twin.dt) == 0.5 and float(inner.dt) == 2.0


def test_it_is_built_without_storage_and_its_constants_follow_it() -> None:
    with torch.device("meta"):
        cell = mt.MemoryCell(WIDTH, N, S, mt.ReallocatingAttention())
    assert {p.device.type for p in cell.parameters()} == {"meta"}
    state = cell(torch.zeros(2, WIDTH, device="meta"))[1]
    assert state.mu.shape == (2, S, N) and state.mu.is_meta
    moved = mt.MemoryCell(WIDTH, N, S, mt.ReallocatingAttention()).to("meta")
    moved.initialize(write_gain=0.5)
    assert {p.device.type for p in mt.relaxed(moved, 0.1).parameters()} == {"meta"}


@pytest.mark.slow
def test_inductor_compiles_a_step_with_gradients() -> None:
    cell = make_cell("soft", output_size=2)
    x, compiled = randn(2, WIDTH), torch.compile(cell, fullgraph=True)
    mine, theirs = (
        torch.autograd.grad(step(x, cell.initial_state((2,)))[0].sum(), cell.slots)[0]
        for step in (cell, compiled)
    )
    torch.testing.assert_close(theirs, mine, rtol=0, atol=1e-12)
