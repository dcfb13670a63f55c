"""The cell: its step, its start, and what it is as a term of an ODE."""

from __future__ import annotations

import itertools

import pytest
import torch
from torch import Tensor
from torchdiffeq import odeint

import mann_torch as mt
from mann_torch.memory.cells.stepping import relaxation
from mann_torch.types import MemoryState
from tests.conftest import randn
from tests.memory.cells import WIDTH, N, S, make_cell


def test_reads_before_it_writes() -> None:
    cell = make_cell()
    state, x = cell.initial_state(), randn(WIDTH)
    seen = cell.attend(x, state)
    read, after = cell(x, state)
    torch.testing.assert_close(read, seen.weights @ state.mu, rtol=0, atol=1e-15)
    moved = 0.75 * cell.features(x) - state.mu
    share = 1 - torch.exp(-seen.weights)
    torch.testing.assert_close(after.mu, state.mu + share.unsqueeze(-1) * moved)


@pytest.mark.parametrize("rule", [mt.RepresentationKeys(), mt.StateKeys(2.5)])
def test_one_step_is_the_flow_of_the_ode_where_the_weights_hold(rule: mt.KeyRule) -> None:
    cell = make_cell("hard", key_rule=rule, clock=True, dt=2.0)
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


def test_output_clock_and_step_length_are_what_the_docstring_says() -> None:
    cell, x = make_cell(output_size=2, clock=True, dt=0.3), randn(WIDTH)
    start = cell.initial_state()
    seen = cell.attend(x, start)
    expected = cell.output.weight @ (cell.features(x) + seen.read) + cell.output.bias
    torch.testing.assert_close(cell(x, start)[0], expected, rtol=0, atol=1e-14)
    pace = torch.log(1 + torch.exp(cell.clock.weight[0] @ x + cell.clock.bias[0]))
    for given, length in ((None, 0.3), (0.7, 0.7), (torch.tensor(0.7, dtype=torch.float64), 0.7)):
        after = cell(x, start, dt=given)[1]
        share = 1 - torch.exp(-seen.weights * pace * length)
        moved = share.unsqueeze(-1) * (0.75 * cell.features(x) - start.mu)
        torch.testing.assert_close(after.mu, start.mu + moved, rtol=0, atol=1e-14)


def test_a_correction_under_soft_attention_keeps_the_weights_of_the_read() -> None:
    cell, x, correction = make_cell(), randn(WIDTH), randn(N)
    seen = cell.attend(x, cell.initial_state())
    share = (1 - torch.exp(-seen.weights)).unsqueeze(-1)
    target = 0.75 * cell.features(x) + correction
    expected = seen.state.mu + share * (target - seen.state.mu)
    torch.testing.assert_close(cell.write(seen, correction).mu, expected, rtol=0, atol=1e-14)


def test_keys_start_at_the_context_or_as_stored_and_resets_are_as_named() -> None:
    cell = make_cell("reallocating_always", key_rule=mt.StateKeys(), reset="raw")
    x, kept = randn(2, WIDTH), MemoryState(randn(S, N), randn(S, WIDTH, seed=1))
    assert torch.equal(cell.initial_state_at(x).keys, x.unsqueeze(-2).expand(2, S, WIDTH))
    cell.memory.store_(kept)
    for start in (cell.initial_state_at(x), cell.initial_state((2,))):
        assert torch.equal(start.keys, kept.keys.expand(2, -1, -1))
        assert torch.equal(start.mu, kept.mu.expand(2, -1, -1))
    after = cell.jump(x, cell.initial_state((2,)))
    assert after.reallocations.tolist() == [1, 1]
    for i, row in enumerate(after.mu):  # sigma itself, not c_w sigma
        assert bool((row == cell.features(x[i])).all(-1).sum() == 1)
        nearest = (after.keys[i] - x[i]).abs().amax(-1).argmin()
        assert int(after.attended[i]) == int(nearest)


def test_switches_are_counted_and_the_first_decision_is_none() -> None:
    cell, state, seen = make_cell("hard"), None, []
    for x in 4 * randn(40, WIDTH):
        _, state = cell(x, state)
        seen.append(int(state.attended))
    changes = sum(a != b for a, b in itertools.pairwise(seen))
    assert int(state.switches) == changes > 0
