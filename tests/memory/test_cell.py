"""The cell: its step, its dtype, its start, and what it is as a term of an ODE."""

from __future__ import annotations

import itertools

import pytest
import torch
from torch import Tensor, nn
from torchdiffeq import odeint

import mann_torch as mt
from mann_torch.memory.stepping import relaxation
from mann_torch.types import MemoryState
from tests.conftest import make_attention, randn

WIDTH, N, S = 3, 6, 4


def make_cell(name: str = "soft", **options: object) -> mt.MemoryCell:
    torch.manual_seed(0)
    return mt.MemoryCell(WIDTH, N, S, make_attention(name), dtype=torch.float64, **options)


def test_it_is_called_as_an_lstm_is() -> None:
    cell, lstm = mt.MemoryCell(10, 20), nn.LSTM(10, 20, batch_first=True)
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


def test_reads_before_it_writes() -> None:
    cell = make_cell()
    state, x = cell.initial_state(), randn(WIDTH)
    seen = cell.attend(x, state)
    read, after = cell(x, state)
    torch.testing.assert_close(read, seen.weights @ state.mu, rtol=0, atol=1e-15)
    moved = 0.75 * cell.features(x) - state.mu
    share = 1 - torch.exp(-seen.weights)
    torch.testing.assert_close(after.mu, state.mu + share.unsqueeze(-1) * moved)


@pytest.mark.parametrize("rule", [mt.RepresentationKeys, mt.StateKeys])
def test_one_step_is_the_flow_of_the_ode_where_the_weights_hold(rule: type) -> None:
    cell = make_cell("hard", key_rule=rule(), clock=True, dt=2.0)
    x, correction, start = randn(WIDTH), 0.01 * randn(N, seed=1), cell.initial_state()
    state = cell.jump(x, start)

    def rate(_: Tensor, flowing: tuple[Tensor, ...]) -> tuple[Tensor, ...]:
        return tuple(cell.d_memory(x, state._replace(mu=flowing[0], keys=flowing[1]), correction))

    t = torch.tensor([0.0, 2.0], dtype=torch.float64)
    mu, keys = (path[-1] for path in odeint(rate, tuple(state.memory), t, rtol=1e-10, atol=1e-12))
    _, after = cell(x, start, correction)
    torch.testing.assert_close(after.mu, mu, rtol=1e-8, atol=1e-10)
    torch.testing.assert_close(after.keys, keys, rtol=1e-8, atol=1e-10)
    assert float((after.mu - state.mu).detach().abs().max()) > 0.1


def test_under_soft_attention_it_converges_to_the_ode_with_the_step() -> None:
    cell, x = make_cell(), randn(WIDTH)
    start = cell.initial_state()

    def rate(_: Tensor, mu: Tensor) -> Tensor:
        return cell.d_memory(x, start._replace(mu=mu)).mu

    t = torch.tensor([0.0, 1.0], dtype=torch.float64)
    exact = odeint(rate, start.mu, t, rtol=1e-11, atol=1e-12)[-1]
    errors = []
    for steps in (8, 16, 32):
        state, dt = start, torch.tensor(1.0 / steps, dtype=torch.float64)
        for _ in range(steps):
            _, state = cell(x, state, dt=dt)
        errors.append(float((state.mu - exact).detach().abs().max()))
    assert all(1.9 < a / b < 2.1 for a, b in itertools.pairwise(errors)), errors


@pytest.mark.parametrize("name", ["soft", "hard", "relaxed_always"])
@pytest.mark.parametrize("dt", [0.0, 1e-12, 1.0, 1e9])
def test_it_is_stable_at_any_step(name: str, dt: float) -> None:
    cell = make_cell(name, key_rule=mt.StateKeys())
    leaf = torch.tensor(dt, dtype=torch.float64, requires_grad=True)
    state = cell.initial_state((2,))
    for x in randn(20, 2, WIDTH):
        _, state = cell(x, state, dt=leaf)
    assert bool(torch.isfinite(state.mu).all()) and float(state.mu.abs().max()) <= 0.75
    (slope,) = torch.autograd.grad(state.mu.sum(), leaf)
    assert bool(torch.isfinite(slope))
    if dt == 0.0:
        assert torch.equal(state.memory.mu, cell.initial_state((2,)).mu) or name != "soft"


def test_relaxation_and_its_slope_are_smooth_through_0() -> None:
    z = torch.tensor([0.0, 1e-9, 1e-7, 1e-3, 1.0, 800.0]).double().requires_grad_()
    value = relaxation(z)
    torch.testing.assert_close(value[1:], (-torch.expm1(-z) / z)[1:], rtol=1e-14, atol=0)
    (slope,) = torch.autograd.grad(value.sum(), z)
    torch.testing.assert_close(slope[:3], torch.full((3,), -0.5).double(), rtol=1e-6, atol=1e-7)


def test_samples_at_uneven_times_take_their_own_step() -> None:
    cell, x, state = make_cell("hard"), randn(3, WIDTH), None
    state = cell.initial_state((3,))
    dt = torch.tensor([0.0, 0.5, 2.0], dtype=torch.float64)
    after = cell(x, state, dt=dt)[1]
    for i in range(3):
        alone = cell(x[i], cell.initial_state(), dt=dt[i])[1]
        torch.testing.assert_close(after.mu[i], alone.mu, rtol=0, atol=1e-15)
    assert torch.equal(after.mu[0], state.mu[0])


def test_dtype_is_that_of_what_goes_in_and_out_and_the_inside_stays_float64() -> None:
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
        assert {p.dtype for p in cell.parameters()} == {torch.float64}
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


def test_gradients_over_a_long_sequence_are_finite_and_detach_cuts_them() -> None:
    cell = make_cell("soft", output_size=1)
    first = randn(2, WIDTH).requires_grad_()
    outputs, state = mt.MemorySequence(cell)(torch.cat([first[None], randn(1500, 2, WIDTH)]))
    (slope,) = torch.autograd.grad(outputs.sum(), first)
    assert bool(torch.isfinite(slope).all()) and bool((slope != 0).any())
    assert state.mu.requires_grad and not state.detach().mu.requires_grad
    assert isinstance(state.detach(), mt.CellState)


def test_the_correction_enters_the_write_law_and_may_depend_on_the_read() -> None:
    cell, x = make_cell("hard"), randn(2, WIDTH)
    seen = cell.attend(x, cell.initial_state((2,)))
    correction = 0.3 * seen.read
    with_it, without = cell.write(seen, correction), cell.write(seen)
    share = (1 - torch.exp(-seen.weights)).unsqueeze(-1) * correction.unsqueeze(-2)
    torch.testing.assert_close(with_it.mu - without.mu, share, rtol=0, atol=1e-15)
    assert torch.equal(cell(x, cell.initial_state((2,)), correction)[1].mu, with_it.mu)


def test_the_papers_start_and_stored_contents() -> None:
    cell, x = make_cell("reallocating_initial"), randn(2, WIDTH)
    state = cell.initial_state_at(x)
    expected = (0.75 * cell.features(x)).unsqueeze(-2).expand(2, S, N)
    torch.testing.assert_close(state.mu, expected, rtol=0, atol=0)
    assert state.active.tolist() == [[True, False, False, False]] * 2
    kept = randn(S, N)
    cell.memory.store_(MemoryState(kept, kept[:, :0]))
    assert torch.equal(cell.initial_state((2,)).mu[1], kept)
    assert bool(cell.initial_state((2,)).active.all())


def test_relaxed_gives_the_smooth_form_of_the_same_cell() -> None:
    cell = make_cell("reallocating_always")
    soft = mt.relaxed(cell, 0.1)
    assert soft.slots is cell.slots and soft.memory.write_gain is cell.memory.write_gain
    outputs, _ = mt.MemorySequence(soft)(3 * randn(5, WIDTH))
    assert outputs.requires_grad
    assert isinstance(cell.memory.attention, mt.ReallocatingAttention)


def test_trace_logs_what_a_member_did() -> None:
    sequence, x = mt.MemorySequence(make_cell("reallocating_always")), 4 * randn(60, 3, WIDTH)
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
    sequence, x = mt.MemorySequence(make_cell(), batch_first=True), randn(3, 5, WIDTH)
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


@pytest.mark.slow
def test_inductor_compiles_a_step_with_gradients() -> None:
    cell = make_cell("soft", output_size=2)
    x, compiled = randn(2, WIDTH), torch.compile(cell, fullgraph=True)
    mine, theirs = (
        torch.autograd.grad(step(x, cell.initial_state((2,)))[0].sum(), cell.slots)[0]
        for step in (cell, compiled)
    )
    torch.testing.assert_close(theirs, mine, rtol=0, atol=1e-12)


def test_bad_settings_are_named() -> None:
    for options, name in (({"output_size": 0}, "output_size"), ({"context_size": 0}, "context")):
        with pytest.raises(mt.ConfigError, match=name):
            make_cell(**options)
    with pytest.raises(mt.DomainError, match="dt"):
        make_cell(dt=0.0)
    with pytest.raises(mt.ConfigError, match="input_size"):
        mt.MemoryCell(0, 3)
