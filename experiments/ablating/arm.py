"""The paper's arm and controller, with payloads that return."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor

from mann_torch import (
    MeasurementNoise,
    PiecewiseConstant,
    RungeKutta,
    Scenario,
    Sinusoid,
    arm_parameters,
    input_rate,
)
from mann_torch.simulation import ClosedLoop, Status
from mann_torch.tuning import MOTION, Ensemble

from ..building.build import build
from ..building.ensembles import composed
from ..settings.ablation_config import ROWS, AblationConfig, ArmTableConfig
from .part import Part

NOISE_RATE = 100.0  # [Hz]
STEADY = 3.0  # [s], the last of a visit
#: No two payloads of a draw are nearer than this share of what separates them in the mean.
APART = 0.5
MASSES = (0.8, 2.3)  # [kg], the paper's; the payload adds to the second
#: Of both joints: amplitude, frequency and offset, and what they vary by (half-width).
REFERENCE = ((1.0, 0.3), (0.5, 0.8), (0.0, 0.0))
VARIED = ((0.3, 0.2), (0.15, 0.24), (0.0, 0.3))


class Draws(NamedTuple):
    """What differs from draw to draw (B, ...)."""

    payloads: Tensor  # (B, visits) [kg]
    reference: Tensor  # (B, 3, 2)
    numbers: Tensor  # (B,) int64, seeds of noise


def drawn(cfg: ArmTableConfig, seed: int) -> Draws:
    """Payloads in rounds of all regimes in random order, none twice running.

    A draw is what a generator of its own number gives, whatever is drawn beside it.
    """
    rows, references = [], []
    low, wide = torch.tensor(REFERENCE).double(), torch.tensor(VARIED).double()
    for number in range(cfg.draws):
        generator = torch.Generator().manual_seed(seed * 1_000_003 + number)
        payloads = _apart(cfg, generator)
        order = list(range(cfg.n_regimes))
        while len(order) < cfg.n_regimes * cfg.visits:
            turn = torch.randperm(cfg.n_regimes, generator=generator).tolist()
            order += turn if turn[0] != order[-1] else []
        rows.append(payloads[order])
        unit = 2.0 * torch.rand(low.shape, generator=generator, dtype=torch.float64) - 1.0
        references.append(low + wide * unit)
    numbers = torch.arange(cfg.draws) + (seed << 32)
    return Draws(torch.stack(rows), torch.stack(references), numbers)


def _apart(cfg: ArmTableConfig, generator: torch.Generator) -> Tensor:
    """Payloads (regimes,) [kg], drawn again until no two are alike."""
    least = APART * cfg.payload / cfg.n_regimes**2
    while True:
        found = cfg.payload * torch.rand(cfg.n_regimes, generator=generator, dtype=torch.float64)
        if bool((found.sort().values.diff() > least).all()):
            return found


def scenario(cfg: ArmTableConfig, draws: Draws) -> Scenario:
    """All draws at once."""
    count, visits = draws.payloads.shape
    second = MASSES[1] + draws.payloads
    masses = torch.stack([torch.full_like(second, MASSES[0]), second], dim=-1)
    changes = cfg.visit_length * torch.arange(1, visits, dtype=torch.float64)
    std = torch.tensor(cfg.noise, dtype=torch.float64).expand(count, -1)
    noise = MeasurementNoise(std, draws.numbers, NOISE_RATE) if any(cfg.noise) else None
    return Scenario(
        Sinusoid(*draws.reference.unbind(dim=1)),
        arm_parameters(MASSES),
        visits * cfg.visit_length,
        schedule={"masses": PiecewiseConstant(changes.expand(count, -1), masses)},
        noise=noise,
    )


def loop_of(cfg: AblationConfig, variant: str) -> ClosedLoop:
    """The paper's controller with the slots of a variant."""
    slots = ROWS["arm"][variant]
    given = ["plant=two_link_arm", "scenario=plain", "controller=nn", "controller.n_hidden=10"]
    if slots.memory:
        given[2:] = ["controller=reallocating_initial", f"memory.n_slots={slots.memory}"]
    if slots.readouts:
        numbers = f"recall_time:{cfg.recall_time},sharpness:{cfg.arm_sharpness}"
        given.append(f"controller.readouts={{n_slots:{slots.readouts},{numbers}}}")
    given += [f"constants.rate_W={cfg.arm.rate}", f"constants.rate_V={cfg.arm.rate}"]
    return build(composed(tuple(given))).loop


def run(cfg: AblationConfig, variant: str, progress: Callable[[int], object]) -> Part:
    """All draws through all visits."""
    torch.set_num_threads(1)
    arm = cfg.arm
    loop = loop_of(cfg, variant)
    generator = torch.Generator().manual_seed(cfg.seed)
    weights = loop.controller.initial_weights((arm.draws,), generator)
    task = scenario(arm, drawn(arm, cfg.seed))
    ensemble = Ensemble(loop, task, weights, RungeKutta(arm.dt), effort_after=0.0)
    with torch.no_grad():
        found = ensemble.run({}, recording=MOTION)
    progress(1)
    squared, t = found.error.square().sum(dim=-1), found.t
    begins = [arm.visit_length * visit for visit in range(arm.n_regimes * arm.visits)]

    def over(begin: float, end: float) -> Tensor:
        inside = (t >= begin - 1e-9) & (t < end - 1e-9)
        return 1e3 * squared[inside].mean(dim=0).sqrt()

    after = torch.stack([over(begin, begin + arm.window) for begin in begins])
    steady_s = min(STEADY, arm.visit_length)
    ends = [begin + arm.visit_length for begin in begins]
    steady = torch.stack([over(end - steady_s, end) for end in ends])
    ok, known = found.status == int(Status.OK), arm.n_regimes
    measures = {
        "first_visit": after[1:known].mean(dim=0),
        "after_return": after[known:].mean(dim=0),
        "steady": steady[known:].mean(dim=0),
        "whole": over(begins[known], ends[-1]),
        "input_rate": input_rate(found).square().sum(dim=-1).sqrt(),
    }
    block = 0.25 * arm.window
    edges = np.arange(0.0, ends[-1] - 0.5 * block, block)
    curve = torch.stack([over(float(at), float(at) + block).square().mean().sqrt() for at in edges])
    return Part(
        {name: torch.where(ok, value, torch.nan).numpy() for name, value in measures.items()},
        {},
        curve.numpy(),
        edges + 0.5 * block,
    )
