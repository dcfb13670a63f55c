"""Relaxed attention: its limit, its gradients, and what it shares with the hard form."""

from __future__ import annotations

import pytest
import torch
from torch import Tensor

import mann_torch as mt
from mann_torch.types import Comparison, MemoryState
from tests.conftest import make_attention, make_controller, make_loop, randn

B, S, N = 200, 5, 6
HARD = {
    "hard": "relaxed_hard",
    "reallocating_initial": "relaxed_initial",
    "reallocating_always": "relaxed_always",
}
COLD = 1e-7
NO_CONTEXT = torch.zeros(0, dtype=torch.float64)


def memory_of(name: str) -> mt.WorkingMemory:
    return mt.WorkingMemory(S, N, make_attention(name))


def at_distances(*offsets: float) -> tuple[Tensor, MemoryState]:
    """Features, and contents whose scaled distances from them these are."""
    hidden = torch.full((N,), 0.5, dtype=torch.float64)
    mu = 0.75 * (hidden + torch.tensor(offsets, dtype=torch.float64).unsqueeze(-1))
    return hidden, MemoryState(mu, mu[..., :0])


@pytest.mark.parametrize("name", HARD)
def test_at_temperature_0_weights_and_jumps_are_those_of_the_hard_form(name: str) -> None:
    hard, soft = memory_of(name), memory_of(HARD[name])
    soft.initialize(temperature=COLD)
    active = torch.rand(B, S, generator=torch.Generator().manual_seed(0)) < 0.7
    active[:, 0] = True
    active[B // 2 :] = True
    mode = hard.initial_mode((B,))._replace(active=active)
    levels = soft.initial_mode((B,))._replace(active=active.double())
    state = MemoryState(0.375 + 0.1 * randn(B, S, N), randn(B, S, 0))
    hidden = 0.5 + 0.1 * randn(B, N, seed=1)
    zero = torch.zeros_like(hidden)
    expected = hard(hidden, zero, zero, state, mode)
    found = soft(hidden, zero, zero, state, levels)
    torch.testing.assert_close(found.weights, expected.weights, rtol=0, atol=1e-12)
    expected_state, expected_mode = hard.jump(hidden, zero, state, mode)
    found_state, found_mode = soft.jump(hidden, zero, state, levels)
    torch.testing.assert_close(found_state.mu, expected_state.mu, rtol=0, atol=1e-12)
    torch.testing.assert_close(found_mode.active, expected_mode.active.double(), rtol=0, atol=1e-12)
    assert torch.equal(found_mode.attended, expected_mode.attended)
    assert torch.equal(found_mode.reallocations, expected_mode.reallocations)
    if hard.attention.reallocates:
        assert 0 < int(found_mode.reallocations.sum()) < B


def test_a_slot_hardly_touched_is_neither_read_nor_counted_as_near() -> None:
    """exp(-0.01 / T) of a reset is as small as what weights compare: it must not decide them."""
    T = 1e-3
    memory = memory_of("relaxed_initial")
    memory.initialize(temperature=T)
    hidden, near_theta = at_distances(0.19, 0.05, 0.05, 0.05, 0.05)
    _, mode = memory.jump(hidden, NO_CONTEXT, near_theta, memory.initial_mode(()))
    touched = float(mode.active[1])
    assert 0.0 < touched < 1e-4
    hidden, later = at_distances(0.195, 0.05, 0.3, 0.3, 0.3)
    weights = memory(hidden, 0 * hidden, NO_CONTEXT, later, mode).weights
    assert float(weights[0]) > 1 - 1e-12
    hidden, beyond = at_distances(0.25, 0.05, 0.3, 0.3, 0.3)
    _, mode = memory.jump(hidden, NO_CONTEXT, beyond, mode)
    assert float(mode.active[1]) > 1 - 1e-12 and int(mode.reallocations) == 1


def test_equal_slots_are_read_as_by_hard_attention() -> None:
    hidden, equal = at_distances(0.1, 0.1, 0.1, 0.1, 0.1)
    memory = memory_of("relaxed_hard")
    weights = memory(hidden, 0 * hidden, NO_CONTEXT, equal, memory.initial_mode(())).weights
    assert weights.tolist() == [1, 0, 0, 0, 0]


@pytest.mark.parametrize("name", ["relaxed_initial", "relaxed_always"])
def test_a_jump_and_a_read_are_differentiable_in_everything(name: str) -> None:
    T, theta = (torch.tensor(v, dtype=torch.float64, requires_grad=True) for v in (0.07, 0.22))
    mu = (0.375 + 0.1 * randn(S, N)).requires_grad_()
    hidden = (0.5 + 0.1 * randn(N, seed=1)).requires_grad_()
    levels = torch.tensor([1.0, 0.96, 0.9, 0.55, 0.3]).double().requires_grad_()

    def after(mu: Tensor, hidden: Tensor, levels: Tensor, T: Tensor, theta: Tensor) -> tuple:
        memory = memory_of(name)
        memory.share("temperature", T)
        memory.share("shift_threshold", theta)
        mode = memory.initial_mode(())._replace(active=levels)
        state, mode = memory.jump(hidden, NO_CONTEXT, MemoryState(mu, mu[..., :0]), mode)
        out = memory(hidden, hidden, NO_CONTEXT, state, mode)
        return out.read, out.weights, state.mu, mode.active, memory.magnitude(state, mode)

    assert torch.autograd.gradcheck(after, (mu, hidden, levels, T, theta))


@pytest.mark.parametrize("temperature", [1e-9, 1e-3, 1.0, 1e6])
def test_no_activity_and_no_temperature_gives_a_nan(temperature: float) -> None:
    memory = memory_of("relaxed_always")
    memory.initialize(temperature=temperature)
    free = memory.tune("temperature", "shift_threshold", "write_gain")
    levels = torch.tensor([1.0, 0.0, 5e-324, 1e-300, 1 - 1e-16]).double().requires_grad_()
    mode = memory.initial_mode(())._replace(active=levels)
    hidden, state = at_distances(0.2, 0.2, 0.0, 0.1, 0.4)
    state, mode = memory.jump(hidden, NO_CONTEXT, state, mode)
    out = memory(hidden, hidden, NO_CONTEXT, state, mode)
    loss = out.read.sum() + state.mu.sum() + mode.active.sum() + memory.magnitude(state, mode)
    found = torch.autograd.grad(loss, [*free, levels])
    assert all(bool(torch.isfinite(value).all()) for value in (loss, *found))


def test_activity_is_a_level_only_where_attention_is_graded() -> None:
    for name, dtype in (("reallocating_initial", torch.bool), ("relaxed_initial", torch.float64)):
        memory = memory_of(name)
        mode = memory.initial_mode((2,))
        assert mode.active.dtype == dtype and mode.active.tolist() == [[1, 0, 0, 0, 0]] * 2
        levels = torch.tensor([0.9, 0.4, 0.6, 0.0, 1e-9], dtype=torch.float64)
        memory.store_(MemoryState(randn(S, N), randn(S, 0)), levels)
        assert memory.initial_mode(()).active.tolist() == [1, 0, 1, 0, 0]


def test_relaxed_shares_the_constants_and_leaves_the_smooth_as_they_are() -> None:
    loop = make_loop("reallocating_always")
    soft = mt.relaxed(loop, 0.05)
    mine, other = loop.controller.constants(), soft.controller.constants()
    assert all(other[name] is value for name, value in mine.items())
    assert set(other) - set(mine) == {"temperature"}
    assert type(loop.controller.memory.attention) is mt.ReallocatingAttention
    assert soft.controller.memory.attention.phase == "always"
    colder = mt.relaxed(soft, 0.01).controller
    assert float(colder.constant("temperature")) == 0.01
    assert colder.constant("shift_threshold") is mine["shift_threshold"]
    for name in ("nn", "soft"):
        smooth = make_controller(name)
        assert mt.relaxed(smooth, 0.1) is smooth
    assert type(mt.relaxed(make_attention("hard"), 0.1)) is mt.RelaxedAttention


def test_a_temperature_may_be_a_tensor_with_a_gradient() -> None:
    root = torch.tensor([0.2, 0.3], dtype=torch.float64, requires_grad=True)
    controller = mt.relaxed(make_controller("hard"), root.square())
    assert controller.batch_shape() == (2,)
    query, keys = randn(2, 3), randn(2, 4, 3, seed=1)
    comparison = Comparison(query, keys, torch.ones(()).double())
    memory = controller.memory
    assert memory is not None
    weights = memory.attention(comparison, torch.ones(2, 4).double())
    (slope,) = torch.autograd.grad(weights[..., 0].sum(), root)
    assert bool((slope != 0).all())
    controller.initialize(temperature=0.1)
    assert controller.constant("temperature").tolist() == 0.1


class Own(mt.HardAttention):
    """An attention of the user's own."""


def test_bad_settings_are_named() -> None:
    for bad in (0.0, -1.0, float("nan"), torch.tensor([0.1, 0.0]).double()):
        with pytest.raises(mt.DomainError, match="temperature"):
            mt.relaxed(make_controller("soft"), bad)
        with pytest.raises(mt.DomainError, match="temperature"):
            mt.RelaxedAttention(bad)
    with pytest.raises(mt.ConfigError, match="phase"):
        mt.RelaxedAttention(0.1, "sometimes")
    with pytest.raises(mt.ConfigError, match="Own has no relaxed form"):
        mt.relaxed(mt.WorkingMemory(S, N, Own()), 0.1)
    with pytest.raises(mt.ConfigError, match="shift_threshold"):
        mt.RelaxedAttention(0.1).constant("shift_threshold")
