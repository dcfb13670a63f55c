"""A learner's pass over streams, at the rate that was best on others."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from mann_torch.memory import MemoryTrace
from mann_torch.trees import map_tensors

from ..sequence_tasks.streams import draw_stream, uniform
from ..settings.memory_config import OnlineRegressionConfig
from .online_learners import Learner, OnlineLearner, samples
from .online_measures import after_each_switch, measured
from .report import member_arrays

PROBES = 64  # points of a forgetting test
TEST, TUNING = 0, 1  # streams


@dataclass(frozen=True)
class Learnt:
    """One variant on all seeds' streams, at its best rate."""

    rate: float
    measures: dict[str, np.ndarray]  # (seeds,) each, over the visits that are returns
    rmse: np.ndarray  # (visits, samples) over seeds
    switches: np.ndarray  # (visits, seeds) RMSE after each switch
    rms: float  # of the functions
    trace: dict[str, np.ndarray]  # of seed `member`; empty without a memory

    def arrays(self) -> dict[str, np.ndarray]:
        """All of it by name."""
        own = {"rate": np.array(self.rate), "rmse": self.rmse, "after_each_switch": self.switches}
        return {**self.measures, **own, **self.trace}


def learn(
    cfg: OnlineRegressionConfig, variant: str, progress: Callable[[int], object] = lambda n: None
) -> Learnt:
    """Choose the variant's rate on streams of their own, then take it to the test's."""
    torch.set_num_threads(1)  # the tensors are small
    scores = []
    for rate in cfg.rates if len(cfg.rates) > 1 else ():
        tried = one_pass(cfg, variant, rate, TUNING, cfg.tuning_visits, progress)
        score = float(tried.measures["after_switch"].mean())
        scores.append(score if math.isfinite(score) else math.inf)
    best = cfg.rates[int(np.argmin(scores))] if scores else cfg.rates[0]
    return one_pass(cfg, variant, best, TEST, cfg.visits, progress)


@torch.inference_mode()
def one_pass(
    cfg: OnlineRegressionConfig,
    variant: str,
    rate: float,
    streams: int,
    visits: int,
    progress: Callable[[int], object],
) -> Learnt:
    """One pass over the streams; the draws are the same for every variant and rate."""
    seeds = np.random.SeedSequence([cfg.seed, streams]).generate_state(2, np.uint64)
    generator, weights = (torch.Generator().manual_seed(int(seed >> 1)) for seed in seeds)
    stream = draw_stream(cfg.seeds, cfg.n_functions, generator)
    learner = OnlineLearner(cfg, variant, rate)
    state = learner.start(cfg, weights)
    probes = [samples(stream, k, PROBES, generator) for k in range(cfg.n_functions)]
    per_visit = round(cfg.visit_length / cfg.dt)
    squared, probed, rows = [], [], []
    for visit in range(cfg.n_functions * visits):
        inputs, answers = samples(stream, visit % cfg.n_functions, per_visit, generator)
        if visit == 0:
            state = learner.begin(state, uniform(weights, cfg.n_slots, *inputs.shape[1:]))
        elif cfg.wiped:
            state = learner.wiped(state)
        for step in range(per_visit):
            looked, before = learner.look(state, inputs[step], jump=True), state.cell
            error = answers[step] - looked.prediction
            state = learner.update(state, inputs[step], error, looked)
            squared.append(error.square())
            if looked.seen is not None and before is not None and state.cell is not None:
                row = MemoryTrace.row(before, looked.seen, state.cell)
                rows.append(map_tensors(lambda leaf: leaf[cfg.member].clone(), row))
        probed.append(torch.stack([_probe(learner, state, *probe) for probe in probes]))
        progress(1)
    errors = torch.stack(squared).reshape(-1, per_visit, cfg.seeds)
    rms = torch.stack([answers for _, answers in probes]).square().mean(dim=1).sqrt()
    return Learnt(
        rate,
        measured(cfg, errors, torch.stack(probed), rms),
        errors.mean(dim=-1).sqrt().numpy(),
        after_each_switch(cfg, errors),
        float(rms.square().mean().sqrt()),
        member_arrays(MemoryTrace.stack(rows)) if rows else {},
    )


def _probe(learner: OnlineLearner, state: Learner, inputs: Tensor, answers: Tensor) -> Tensor:
    """RMSE (B,) on a function's points, nothing learned; of readouts, of the best slot."""
    found = learner.held(state, inputs)  # (S, points, B)
    return (answers - found).square().mean(dim=1).sqrt().amin(dim=0)
