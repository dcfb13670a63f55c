"""Write law, read, and reallocation."""

import pytest
import torch
from torchdiffeq import odeint

import mann_torch as mt
from mann_torch.types import MemoryMode, MemoryState
from tests.conftest import make_attention, randn

S, N = 4, 3


def memory_of(name: str, **options: object) -> mt.WorkingMemory:
    return mt.WorkingMemory(S, N, make_attention(name), **options)  # type: ignore[arg-type]


def mode_with(memory: mt.WorkingMemory, active: list[bool]) -> MemoryMode:
    return memory.initial_mode(())._replace(active=torch.tensor(active))


NO_CONTEXT = torch.zeros(0, dtype=torch.float64)


def test_attended_slot_decays_exponentially_to_the_fixed_point_and_others_stay() -> None:
    memory = memory_of("hard")
    mu0, hidden, correction = randn(S, N), torch.sigmoid(randn(N, seed=1)), 0.1 * randn(N, seed=2)
    mu0[2] = 0.75 * hidden  # slot 2 is nearest, and stays so
    mode = memory.initial_mode(())

    def rate(_: torch.Tensor, mu: torch.Tensor) -> torch.Tensor:
        state = MemoryState(mu, mu[..., :0])
        return memory(hidden, correction, NO_CONTEXT, state, mode).d_memory.mu

    t = torch.linspace(0, 3, 7, dtype=torch.float64)
    path = odeint(rate, mu0, t, rtol=1e-11, atol=1e-12)
    target = 0.75 * hidden + correction
    exact = target + (mu0[2] - target) * torch.exp(-t).unsqueeze(-1)
    torch.testing.assert_close(path[:, 2], exact, rtol=1e-9, atol=1e-9)
    torch.testing.assert_close(path[-1, [0, 1, 3]], mu0[[0, 1, 3]], rtol=1e-14, atol=0)


def test_read_is_the_weighted_sum_of_contents() -> None:
    memory = memory_of("soft")
    state = MemoryState(randn(S, N), randn(S, 0))
    hidden = torch.sigmoid(randn(N, seed=3))
    out = memory(hidden, torch.zeros(N).double(), NO_CONTEXT, state, memory.initial_mode(()))
    expected = sum(out.weights[i] * state.mu[i] for i in range(S))
    torch.testing.assert_close(out.read, expected, rtol=1e-14, atol=1e-14)
    scores = torch.exp(torch.stack([state.mu[i] @ hidden for i in range(S)]))
    torch.testing.assert_close(out.weights, scores / scores.sum(), rtol=1e-13, atol=1e-13)


def test_nearest_key_wins_and_inactive_slots_do_not() -> None:
    memory = memory_of("hard")
    hidden = torch.full((N,), 0.5, dtype=torch.float64)
    mu = 0.75 * (hidden + torch.tensor([0.3, 0.1, 0.2, 0.05]).double().unsqueeze(-1))
    state = MemoryState(mu, mu[..., :0])
    zero = torch.zeros(N, dtype=torch.float64)
    everyone = memory(hidden, zero, NO_CONTEXT, state, mode_with(memory, [True] * 4))
    assert everyone.weights.tolist() == [0, 0, 0, 1]
    without = memory(hidden, zero, NO_CONTEXT, state, mode_with(memory, [True, True, True, False]))
    assert without.weights.tolist() == [0, 1, 0, 0]


@pytest.mark.parametrize(("reset", "scale"), [("scaled", 0.75), ("raw", 1.0)])
def test_growing_resets_exactly_the_next_unused_slot(reset: str, scale: float) -> None:
    memory = memory_of("reallocating_initial", reset=reset)
    hidden = torch.sigmoid(randn(N))
    mu = 0.75 * (hidden + 0.5) + torch.zeros(S, 1).double()
    state = MemoryState(mu, mu[..., :0])
    after, mode = memory.jump(
        hidden, NO_CONTEXT, state, mode_with(memory, [True, True, False, False])
    )
    torch.testing.assert_close(after.mu[2], scale * hidden, rtol=0, atol=0)
    assert torch.equal(after.mu[[0, 1, 3]], mu[[0, 1, 3]])
    assert mode.active.tolist() == [True, True, True, False]
    assert int(mode.reallocations) == 1 and int(mode.attended) == 2


def test_always_resets_exactly_the_least_relevant_slot_and_initial_stops() -> None:
    hidden = torch.sigmoid(randn(N))
    offsets = torch.tensor([0.3, 0.6, 0.25, 0.4], dtype=torch.float64).unsqueeze(-1)
    mu = 0.75 * (hidden + offsets)
    state = MemoryState(mu, mu[..., :0])
    always = memory_of("reallocating_always")
    after, mode = always.jump(hidden, NO_CONTEXT, state, mode_with(always, [True] * 4))
    torch.testing.assert_close(after.mu[1], 0.75 * hidden, rtol=0, atol=0)
    assert torch.equal(after.mu[[0, 2, 3]], mu[[0, 2, 3]]) and int(mode.reallocations) == 1
    initial = memory_of("reallocating_initial")
    after, mode = initial.jump(hidden, NO_CONTEXT, state, mode_with(initial, [True] * 4))
    assert torch.equal(after.mu, mu) and int(mode.reallocations) == 0


def test_a_relevant_slot_prevents_the_shift_at_the_threshold() -> None:
    memory = memory_of("reallocating_always")
    hidden = torch.full((N,), 0.5, dtype=torch.float64)
    for offset, resets in ((0.19, 0), (0.21, 1)):
        offsets = torch.tensor([offset, 0.9, 0.9, 0.9], dtype=torch.float64).unsqueeze(-1)
        mu = 0.75 * (hidden + offsets)
        _, mode = memory.jump(
            hidden, NO_CONTEXT, MemoryState(mu, mu[..., :0]), mode_with(memory, [True] * 4)
        )
        assert int(mode.reallocations) == resets


def test_state_keys_move_only_for_the_attended_slot_and_reset_to_the_state() -> None:
    attention = mt.ReallocatingAttention("always")
    memory = mt.WorkingMemory(S, N, attention, mt.StateKeys(key_rate=2.0), context_width=2)
    context, keys = randn(2), randn(S, 2, seed=1)
    keys[1] = context + 0.01
    keys[0] = 0.75 * context  # c_w scales contents, not keys
    hidden = torch.sigmoid(randn(N))
    state = MemoryState(0.75 * hidden + torch.zeros(S, N).double(), keys)
    out = memory(hidden, hidden * 0, context, state, mode_with(memory, [True] * 4))
    assert out.weights.tolist() == [0, 1, 0, 0]
    expected = torch.zeros(S, 2, dtype=torch.float64)
    expected[1] = -2.0 * (keys[1] - context)
    torch.testing.assert_close(out.d_memory.keys, expected, rtol=1e-14, atol=1e-14)
    far = MemoryState(state.mu + torch.tensor([0.5, 0.6, 0.9, 0.7]).double().unsqueeze(-1), keys)
    after, _ = memory.jump(hidden, context, far, mode_with(memory, [True] * 4))
    assert torch.equal(after.keys[2], context) and torch.equal(after.keys[:2], keys[:2])


def test_stored_contents_survive_a_state_dict_round_trip() -> None:
    memory = memory_of("hard")
    memory.store_(MemoryState(randn(S, N), randn(S, 0)))
    twin = memory_of("hard")
    twin.load_state_dict(memory.state_dict())
    state = twin.initial_state(torch.zeros(7, N).double(), torch.zeros(7, 0).double())
    assert torch.equal(state.mu, randn(S, N).expand(7, S, N))
    with pytest.raises(mt.ShapeError, match="store_"):
        memory.store_(MemoryState(randn(2, S, N), randn(2, S, 0)))


def test_bad_settings_are_named() -> None:
    with pytest.raises(mt.ConfigError, match="n_slots"):
        mt.WorkingMemory(0, N, mt.HardAttention())
    with pytest.raises(mt.ConfigError, match="reset"):
        mt.WorkingMemory(1, N, mt.HardAttention(), reset="other")
    with pytest.raises(mt.ConfigError, match="context_width"):
        mt.WorkingMemory(1, N, mt.HardAttention(), mt.StateKeys())
    with pytest.raises(mt.ConfigError, match="phase"):
        mt.ReallocatingAttention("sometimes")
    with pytest.raises(mt.DomainError, match="shift_threshold"):
        mt.ReallocatingAttention(shift_threshold=-0.1)
