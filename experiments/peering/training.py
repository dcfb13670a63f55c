"""One training: a model, a task, a seed."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from itertools import repeat

import numpy as np
import torch
from torch import Tensor, nn

from ..learning.report import member_arrays
from ..sequence_tasks.every import TASKS
from ..sequence_tasks.task import Batch, Task
from ..settings.peers_config import PeersConfig, TaskConfig
from .memory import Memory
from .models import build_model, matched_size, n_parameters

#: How near its own best score a model has come when it has got there.
NEAR = 0.01
#: Sequences that are evaluated at once.
AT_ONCE = 250


@dataclass(frozen=True)
class Learned:
    """Scores on the way, P of them, and on new sequences at the end; NaN: it diverged."""

    score: float
    curve: np.ndarray  # (P,) on the sequences of an evaluation
    at: np.ndarray  # (P,) iterations done by then
    seconds: np.ndarray  # (P,) of training by then, without evaluations
    start_s: float  # a first pass and gradient before training, engines compiled where they are
    size: int
    parameters: int
    trace: dict[str, np.ndarray]  # of test sequence `member`, seed 0; empty without a memory


def n_iterations(cfg: PeersConfig, task: str, variant: str) -> int:
    """Of one training, at most."""
    settings: TaskConfig = getattr(cfg, task)
    return max(1, round(settings.iterations * cfg.shares.get(variant, 1.0)))


def learn(
    cfg: PeersConfig,
    name: str,
    variant: str,
    seed: int,
    progress: Callable[[int], object] = lambda n: None,
) -> Learned:
    """Train by Adam until all is right in two evaluations running, or to the last iteration.

    All variants see the same sequences: those of a seed.
    """
    torch.set_num_threads(1)
    settings: TaskConfig = getattr(cfg, name)
    task, (start, train, watch, test) = TASKS[name](cfg), _draws(cfg, name, seed)
    model = build_model(cfg, task, variant, start)
    watched = task.draw(cfg.evaluated, watch)
    optimizer = torch.optim.Adam(
        [p for p in model.parameters() if p.requires_grad], lr=cfg.rates[variant]
    )
    start_s = _warmed_up(model, task, task.draw(settings.batch, watch))
    iterations, spent, done = n_iterations(cfg, name, variant), 0.0, 0
    curve, at, seconds = [evaluated(model, task, watched)], [0], [0.0]
    while done < iterations and not _is_over(task, curve):
        count = min(cfg.every, iterations - done)
        batches = [task.draw(settings.batch, train) for _ in range(count)]
        begun = time.perf_counter()
        for batch in batches:
            _step(model, optimizer, task, batch)
            progress(1)
        spent, done = spent + time.perf_counter() - begun, done + count
        curve.append(evaluated(model, task, watched))
        at.append(done)
        seconds.append(spent)
    progress(iterations - done)
    final = task.draw(cfg.tested, test)
    trace = {}
    if isinstance(model, Memory) and seed == 0:
        trace = _traced(model, final, cfg.member)
    return Learned(
        evaluated(model, task, final),
        np.array(curve),
        np.array(at),
        np.array(seconds),
        start_s,
        matched_size(cfg, task, variant),
        n_parameters(model),
        trace,
    )


def first_near_best(curve: np.ndarray, lower_is_better: bool) -> int:
    """Which evaluation (P,) was the first within `NEAR` of the best of all.

    For accuracies 0.01 of an accuracy, for errors 1 % of the error. -1 where one is not finite.
    """
    if not np.isfinite(curve).all():
        return -1
    if lower_is_better:
        return int(np.argmax(curve <= curve.min() * (1.0 + NEAR)))
    return int(np.argmax(curve >= curve.max() - NEAR))


@torch.inference_mode()
def evaluated(model: nn.Module, task: Task, batch: Batch) -> float:
    """The model's score; it takes some sequences at once, as memories need room."""
    found = [model(x, valid) for x, valid in zip(_some(batch.x), _some(batch.valid), strict=False)]
    return task.score(torch.cat(found, dim=1), batch)


def test_sequences(cfg: PeersConfig, name: str) -> Batch:
    """Of seed 0: what pictures show and notes judge."""
    return TASKS[name](cfg).draw(cfg.tested, _draws(cfg, name, 0)[3])


def _some(leaf: Tensor | None) -> Iterable[Tensor | None]:
    """(T, B, ...) in pieces of `AT_ONCE` sequences; None as often as you like."""
    return repeat(None) if leaf is None else leaf.split(AT_ONCE, dim=1)


def _is_over(task: Task, curve: list[float]) -> bool:
    if not math.isfinite(curve[-1]):
        return True
    return len(curve) > 1 and all(task.is_perfect(score) for score in curve[-2:])


def _step(model: nn.Module, optimizer: torch.optim.Optimizer, task: Task, batch: Batch) -> None:
    loss = task.loss(model(batch.x, batch.valid), batch)
    optimizer.zero_grad()
    loss.backward()
    nn.utils.clip_grad_norm_(model.parameters(), 1.0)
    optimizer.step()


def _warmed_up(model: nn.Module, task: Task, batch: Batch) -> float:
    """How long a first pass and its gradient take [s]; nothing is learned by it."""
    begun = time.perf_counter()
    task.loss(model(batch.x, batch.valid), batch).backward()
    model.zero_grad()
    return time.perf_counter() - begun


def _traced(model: Memory, batch: Batch, member: int) -> dict[str, np.ndarray]:
    """What the memory did up to the sequence's end."""
    x = batch.x[:, member : member + 1]
    if batch.valid is not None:
        x = x[batch.valid[:, member]]
    return member_arrays(model.sequence.trace(x), 0)


def _draws(
    cfg: PeersConfig, name: str, seed: int
) -> tuple[int, torch.Generator, torch.Generator, torch.Generator]:
    """A seed for first weights; generators of sequences to train, to evaluate and to test on."""
    key = [cfg.seed, seed, *name.encode()]
    state = np.random.SeedSequence(key).generate_state(4, np.uint64)
    start, *others = (int(number >> 1) for number in state)
    train, watch, test = (torch.Generator().manual_seed(number) for number in others)
    return start, train, watch, test
