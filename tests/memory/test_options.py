"""What the defaults add to the paper's law, and that they learn."""

from __future__ import annotations

import pytest
import torch
from torch import Tensor, nn

import mann_torch as mt
from mann_torch.memory import Directions, Inertia
from tests.conftest import randn

WIDTH, N, S = 3, 6, 4
ONE = torch.tensor(1.0, dtype=torch.float64)


def make(**options: object) -> mt.MemoryCell:
    torch.manual_seed(0)
    return mt.MemoryCell(WIDTH, N, S, dtype=torch.float64, **options)


def sigmoid(z: Tensor) -> Tensor:
    return 1 / (1 + torch.exp(-z))


def test_the_exponential_under_a_clock_is_a_sigmoid_gate() -> None:
    """1 - exp(-log(1 + exp z)) = sigmoid(z)."""
    cell, x = make(), randn(WIDTH)
    state = cell.initial_state()
    seen = cell.attend(x, state)
    z = cell.clock.weight[0] @ x + cell.clock.bias[0] + cell.clock_feedback.weight[0] @ seen.hidden
    after = cell.write(seen)
    share = sigmoid(z)
    expected = torch.cat([(share * seen.hidden)[None], state.mu[1:]])
    torch.testing.assert_close(after.mu, expected, rtol=0, atol=1e-14)
    keys = state.keys[0] + share * (seen.context - state.keys[0])
    torch.testing.assert_close(after.keys[0], keys, rtol=0, atol=1e-14)
    assert torch.equal(after.keys[1:], state.keys[1:])


def test_slots_have_their_turn_once_more_than_half_is_written() -> None:
    cell, x = make(clock=False), randn(WIDTH)
    state, turns = cell.initial_state(), []
    for dt in (1.0, 0.5, 0.69, 0.70, 5.0, 5.0, 5.0):  # 1 - exp(-log 2) = 1/2
        _, state = cell(x, state, dt=dt)
        turns.append(int(state.next))
    assert turns == [1, 1, 1, 2, 3, 0, 1]


def test_features_with_inertia_follow_their_ode_over_a_step_with_the_target_held() -> None:
    torch.manual_seed(0)
    layer = Inertia(WIDTH, N).double()
    target, pace, before = randn(N), randn(N, seed=1), randn(N, seed=2)
    rate = torch.log(1 + torch.exp(pace + layer.pace_feedback.weight @ before))
    goal = torch.tanh(target + layer.feedback.weight @ before)
    exact = goal + torch.exp(-rate) * (before - goal)
    torch.testing.assert_close(layer(target, pace, before), exact, rtol=0, atol=1e-14)
    start = -1 / torch.log1p(-sigmoid(layer.pace.bias.detach()))  # time constants, in steps
    assert float(start.max()) < 61 and float(start.min()) > 0.3
    wide = Inertia(WIDTH, 4000)
    spread = -1 / torch.log1p(-torch.sigmoid(wide.pace.bias.detach()))
    assert float(spread.max()) > 50 and float((spread > 10).float().mean()) > 0.3


def test_directions_do_not_depend_on_size_and_fade_at_none() -> None:
    torch.manual_seed(0)
    layer = Directions(WIDTH, 5).double()
    nn.init.zeros_(layer.bias)
    x = randn(WIDTH)
    torch.testing.assert_close(layer(x).norm(), 2.5 * ONE, rtol=1e-5, atol=0)
    torch.testing.assert_close(layer(1e3 * x), layer(10 * x), rtol=1e-6, atol=0)
    zero = torch.zeros(WIDTH, dtype=torch.float64, requires_grad=True)
    layer(zero).sum().backward()
    assert bool(torch.isfinite(zero.grad).all())


def test_the_paper_is_one_named_setting() -> None:
    torch.manual_seed(0)
    cell = mt.MemoryCell.paper(WIDTH, N, S, dtype=torch.float64)
    x, state = randn(WIDTH), cell.initial_state()
    sigma = sigmoid(cell.features[0].weight @ x + cell.features[0].bias)
    w = torch.softmax(state.mu @ sigma, -1)
    read, after = cell(x, state)
    torch.testing.assert_close(read, w @ state.mu, rtol=0, atol=1e-14)
    moved = (1 - torch.exp(-w)).unsqueeze(-1) * (0.75 * sigma - state.mu)
    torch.testing.assert_close(after.mu, state.mu + moved, rtol=0, atol=1e-14)
    assert mt.MemoryCell.paper(WIDTH, N, clock=True).clock is not None


def test_settings_that_contradict_each_other_are_named() -> None:
    with pytest.raises(mt.ConfigError, match="writing='attended'"):
        make(attention=mt.ReallocatingAttention(), writing="next")
    with pytest.raises(mt.ConfigError, match="writing"):
        make(writing="last")
    assert make(attention=mt.ReallocatingAttention()).writing == "attended"
    for given in ("hard", mt.HardAttention):
        with pytest.raises(mt.KindError, match=r"attention = .*: SoftAttention\(\), Hard"):
            make(attention=given)
    with pytest.raises(mt.KindError, match=r"key_rule = 'state': .*: StateKeys\(\), Rep"):
        make(key_rule="state")


# -- learning -----------------------------------------------------------------------------------


def first_symbol(generator: torch.Generator, batch: int = 32) -> tuple[Tensor, Tensor, Tensor]:
    """Up to 30 of 4 symbols, one-hot; the class is the first one. x, class, last step."""
    symbols = torch.randint(4, (30, batch), generator=generator)
    length = torch.randint(1, 31, (batch,), generator=generator)
    shown = torch.arange(30).unsqueeze(-1) < length
    x = nn.functional.one_hot(symbols, 4).float() * shown.unsqueeze(-1)
    asked = torch.arange(30).unsqueeze(-1) == length - 1
    return x, symbols[:1].expand(30, batch), asked


def copying(generator: torch.Generator, batch: int = 32) -> tuple[Tensor, Tensor, Tensor]:
    """5 of 8 symbols, 50 blanks, then 5 cues: which were they?"""
    symbols = torch.randint(8, (5, batch), generator=generator)
    x, answer = torch.zeros(60, batch, 10), torch.zeros(60, batch, dtype=torch.int64)
    x[:5, :, :8] = nn.functional.one_hot(symbols, 8).float()
    x[5:55, :, 8], x[55:, :, 9], answer[55:] = 1.0, 1.0, symbols
    return x, answer, (torch.arange(60) >= 55).unsqueeze(-1).expand(60, batch)


def recalling(generator: torch.Generator, batch: int = 64) -> tuple[Tensor, Tensor, Tensor]:
    """6 pairs of 8 keys and 8 values, then each key in another order: which value?"""
    keys = torch.rand(batch, 8, generator=generator).argsort(-1)[:, :6]
    values = torch.randint(8, (batch, 6), generator=generator)
    order = torch.rand(batch, 6, generator=generator).argsort(-1)
    one = nn.functional.one_hot
    shown = torch.cat([one(keys, 8), one(values, 8), torch.zeros(batch, 6, 1)], -1)
    asked = torch.cat([one(keys.gather(1, order), 8), torch.zeros(batch, 6, 8)], -1)
    asked = torch.cat([asked, torch.ones(batch, 6, 1)], -1)
    x = torch.cat([shown, asked], 1).transpose(0, 1)
    answer = torch.cat([values, values.gather(1, order)], 1).T
    return x, answer, (torch.arange(12) >= 6).unsqueeze(-1).expand(12, batch)


def accuracy_after(task: object, iterations: int, seed: int, slowest: float = 1e-3) -> float:
    """Of a cell with its defaults, by Adam at 1e-2 down to `slowest`, on 20 new batches."""
    torch.manual_seed(seed)
    generator = torch.Generator().manual_seed(1000 + seed)
    x, answer, _ = task(generator)
    sequence = mt.MemorySequence(mt.MemoryCell(x.shape[-1], 64))
    head = nn.Linear(64, int(answer.max()) + 1)
    free = [p for p in (*sequence.parameters(), *head.parameters()) if p.requires_grad]
    optimizer = torch.optim.Adam(free, lr=1e-2)
    pace = (slowest / 1e-2) ** (1 / iterations)
    slower = torch.optim.lr_scheduler.ExponentialLR(optimizer, pace)
    for _ in range(iterations):
        x, answer, asked = task(generator)
        scores = head(sequence(x)[0])
        loss = nn.functional.cross_entropy(scores[asked], answer[asked])
        optimizer.zero_grad()
        loss.backward()
        nn.utils.clip_grad_norm_(free, 1.0)
        optimizer.step()
        slower.step()
    right = []
    with torch.no_grad():
        for _ in range(20):
            x, answer, asked = task(generator)
            right.append((head(sequence(x)[0])[asked].argmax(-1) == answer[asked]).float().mean())
    return float(torch.stack(right).mean())


def test_with_its_defaults_it_recalls_six_pairs() -> None:
    assert accuracy_after(recalling, 100, seed=0) > 0.95  # an LSTM of this size: 0.36


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(1, 5))
def test_it_recalls_from_every_seed(seed: int) -> None:
    assert accuracy_after(recalling, 150, seed) > 0.95


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(5))
def test_it_tells_the_first_symbol(seed: int) -> None:
    assert accuracy_after(first_symbol, 300, seed) == 1.0  # half of 20 epochs of 1024 sequences


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(5))
def test_it_copies_over_a_gap(seed: int) -> None:
    assert accuracy_after(copying, 2500, seed, 3e-4) > 0.999  # an LSTM: 1/8, guessing
