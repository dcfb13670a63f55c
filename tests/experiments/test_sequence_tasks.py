"""What the tasks for sequence models are."""

from itertools import pairwise

import pytest
import torch
from torch import Tensor

from experiments.sequence_tasks.every import TASKS
from experiments.sequence_tasks.recall import without_keys
from experiments.sequence_tasks.returning import Returning
from experiments.sequence_tasks.task import Batch
from experiments.settings.peers_config import PeersConfig, ReturningTaskConfig


def drawn(name: str, count: int = 50, seed: int = 0) -> Batch:
    return TASKS[name](PeersConfig()).draw(count, torch.Generator().manual_seed(seed))


@pytest.mark.parametrize("name", TASKS)
def test_sequences_are_those_of_the_generator_and_only_what_is_learned_is_judged(name: str) -> None:
    one, same, other = drawn(name), drawn(name), drawn(name, seed=1)
    assert torch.equal(one.x, same.x) and torch.equal(one.target, same.target)
    assert not torch.equal(one.x, other.x)
    task = TASKS[name](PeersConfig())
    assert one.x.dtype == torch.float32 and one.x.shape[1:] == (50, task.n_inputs)
    assert bool((one.asked | ~one.judged).all()) and bool(one.judged.any(dim=0).all())
    assert len(task.labels(one, 3)) == len(one.x)


def test_recall_has_one_right_answer() -> None:
    cfg, batch = PeersConfig().recall, drawn("recall")
    P, K, x = cfg.n_pairs, cfg.n_keys, batch.x
    for b in range(50):
        shown = {int(row[:K].argmax()): int(row[K:-1].argmax()) for row in x[:P, b]}
        assert len(shown) == P and bool((x[:P, b, -1] == 0).all())
        asked = [int(row[:K].argmax()) for row in x[P:, b]]
        assert [shown[key] for key in asked] == batch.target[P:, b].tolist()
        assert bool((x[P:, b, K:-1] == 0).all())
    assert batch.asked[P:].all() and not batch.asked[:P].any()
    assert 1 / P < without_keys(batch.target[P:]) < 0.5


def test_without_keys_is_the_share_of_the_commonest_answer() -> None:
    answers = torch.tensor([[1, 2], [1, 3], [4, 4]])
    assert without_keys(answers) == pytest.approx((2 / 3 + 1 / 3) / 2)


def test_copy_asks_for_the_symbols_in_order_after_nothing() -> None:
    cfg, batch = PeersConfig().copy, drawn("copy")
    n, x = cfg.length, batch.x
    assert len(x) == 2 * n + cfg.gap and bool((x[n:-n] == 0).all())
    assert torch.equal(x[:n, :, :-1].argmax(dim=-1), batch.target[-n:])
    assert bool((x[:n].sum(dim=-1) == 1).all())
    assert bool((x[-n:, :, :-1] == 0).all()) and bool((x[-n:, :, -1] == 1).all())
    assert batch.asked[-n:].all() and not batch.asked[:-n].any()


def test_the_first_symbol_is_asked_for_where_a_sequence_ends() -> None:
    cfg, batch = PeersConfig().gap, drawn("gap", 400)
    assert batch.valid is not None
    lengths = batch.valid.sum(dim=0)
    assert lengths.min() < 20 and lengths.max() > 90
    assert cfg.shortest <= lengths.min() and lengths.max() <= cfg.longest
    assert bool((batch.x.sum(dim=-1) == batch.valid).all())  # a symbol at each valid step, no more
    assert bool((batch.asked.sum(dim=0) == 1).all())
    assert torch.equal(batch.asked.int().argmax(dim=0), lengths - 1)
    assert torch.equal(batch.x[0].argmax(dim=-1), batch.target[-1])
    last = batch.x[lengths - 1, torch.arange(400)].argmax(dim=-1)
    assert abs(float((last == batch.target[0]).double().mean()) - 0.25) < 0.07  # it tells nothing


def fitted(x: Tensor, y: Tensor, at: Tensor) -> Tensor:
    """a sin 1.5 x + b cos 1.5 x through two points (2,), at a third ()."""
    basis = torch.stack([torch.sin(1.5 * x), torch.cos(1.5 * x)], dim=-1)
    a, b = torch.linalg.solve(basis, y)
    return a * torch.sin(1.5 * at) + b * torch.cos(1.5 * at)


def test_a_function_comes_back_and_then_it_is_judged() -> None:
    batch = drawn("returning", 10)
    x, last_x, last_y = batch.x.double().unbind(dim=-1)
    torch.testing.assert_close(last_x[1:], x[:-1], rtol=0, atol=0)
    torch.testing.assert_close(last_y[1:], batch.target[:-1].double(), rtol=0, atol=0)
    y, before, runs = batch.target.double(), [], 0
    for b in range(10):
        judged = batch.judged[:, b]
        for t in torch.nonzero(judged).squeeze(-1).tolist():
            if judged[t - 1]:
                continue
            change, runs = t - 1, runs + 1  # the first step of the visit isn't judged
            found = torch.stack(
                [fitted(x[s : s + 2, b], y[s : s + 2, b], x[t, b]) for s in range(change - 1)]
            )
            error = (found - y[t, b]).abs()
            assert float(error.min()) < 1e-4  # an earlier visit's function tells the answer
            before.append(float(error[-1]))  # but not that of the visit just left
    assert runs > 10 and sorted(before)[len(before) // 4] > 0.05


def test_the_same_function_is_not_visited_twice_running() -> None:
    cfg = ReturningTaskConfig(n_functions=2, steps=40, shortest=3, longest=5, window=2)
    batch = Returning(cfg).draw(20, torch.Generator().manual_seed(2))
    since = torch.nonzero(batch.judged[:, 0]).squeeze(-1).tolist()
    visits = [t for t in since if t - 1 not in since]
    assert all(3 <= later - sooner <= 5 for sooner, later in pairwise(visits))
    assert visits[0] <= 2 * 5 + 1  # of two functions, the third visit is a return


def test_scores_are_what_they_are_called() -> None:
    task, batch = TASKS["returning"](PeersConfig()), drawn("returning")
    right = batch.target.unsqueeze(-1)
    assert task.score(right, batch) == 0.0
    assert task.score(torch.zeros_like(right), batch) == pytest.approx(1.0)
    assert task.score(-right, batch) == pytest.approx(2.0)
    spoiled = torch.where(batch.judged.unsqueeze(-1), right, 77.0)
    assert task.score(spoiled, batch) == 0.0  # what isn't judged doesn't count
    assert task.loss(spoiled, batch) > 1.0  # but it is learned
    task, batch = TASKS["copy"](PeersConfig()), drawn("copy")
    sure = 50.0 * torch.nn.functional.one_hot(batch.target, 8)
    assert task.score(sure, batch) == 1.0 and task.is_perfect(1.0)
    assert float(task.loss(sure, batch)) < 1e-12
    assert task.score(sure.roll(1, -1), batch) == 0.0
    assert torch.tensor(task.score(sure + torch.nan, batch)).isnan()
