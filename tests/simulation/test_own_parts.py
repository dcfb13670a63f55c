"""Parts that a user writes in torch run compiled, with their gradients, and no kernel code."""

from __future__ import annotations

import dataclasses
import math
from typing import Any

import pytest
import torch
from torch import Tensor, nn

import mann_torch as mt
from mann_torch.plants import ArmCoefficients, NLinkArm
from mann_torch.simulation.solvers.solver import Flow, Solver
from mann_torch.types import (
    ControllerState,
    ControlOutput,
    Measurement,
    MemoryMode,
    MemoryState,
    ReferenceSample,
)
from tests.conftest import generator, randn
from tests.pages import part_of


class DraggedArm(mt.TwoLinkArm):
    """The arm in water: drag against the square of the rates, with a parameter of its own."""

    def __init__(self) -> None:
        super().__init__()
        self.drag = nn.Parameter(torch.tensor([0.4, 0.1], dtype=torch.float64))

    def load(self, q: Tensor, qd: Tensor, coefficients: ArmCoefficients) -> Tensor:
        return super().load(q, qd, coefficients) + self.drag * qd * qd.abs()


class LearnedTorque(mt.MannController):
    """The MANN controller plus a small network of the user's own on the measured state."""

    def __init__(self, **arguments: Any) -> None:
        super().__init__(2, 6, **arguments)
        torch.manual_seed(3)
        layers = nn.Linear(4, 5), nn.Tanh(), nn.LayerNorm(5), nn.Linear(5, 2)
        self.extra = nn.Sequential(*layers).double()

    def forward(
        self,
        reference: ReferenceSample,
        measurement: Measurement,
        state: ControllerState,
        mode: MemoryMode | None,
    ) -> ControlOutput:
        found = super().forward(reference, measurement, state, mode)
        return found._replace(input=found.input + self.extra(torch.cat(measurement, dim=-1)))


class Waypoints(mt.Reference):
    """Minimum-jerk moves between points (K, n), `period` [s] each: the piece is found by index."""

    def __init__(self, points: Tensor, period: float) -> None:
        super().__init__()
        self.points: Tensor
        self.hold("points", points, event_dims=2)
        self.period, self.width = period, points.shape[-1]

    def at(self, t: Tensor) -> ReferenceSample:
        last, n = self.points.shape[-2:]
        piece = torch.clamp(torch.floor(t / self.period), 0, last - 2).long()
        s = (t / self.period - piece).clamp(0.0, 1.0)
        wide = torch.broadcast_shapes(piece.shape[:-1], self.points.shape[:-2])
        points = self.points.expand(*wide, last, n)
        index = piece.unsqueeze(-1).expand(*wide, 1, n)
        begin, end = (points.gather(-2, index + k).squeeze(-2) for k in (0, 1))
        shape = 10 * s**3 - 15 * s**4 + 6 * s**5
        rate = (30 * s**2 - 60 * s**3 + 30 * s**4) / self.period
        bend = (60 * s - 180 * s**2 + 120 * s**3) / self.period**2
        way = end - begin
        return ReferenceSample(begin + way * shape, way * rate, way * bend)


class Heun(Solver):
    """Heun's explicit method."""

    @property
    def name(self) -> str:
        return "heun"

    def step(self, flow: Flow, t: Tensor, h: Tensor, y: Tensor) -> Tensor:
        first = flow(t, y)
        return y + 0.5 * h * (first + flow(t + h, y + h * first))


def printed() -> dict[str, Any]:
    """The attentions and the key rule of docs/write, as printed there."""
    names: dict[str, Any] = {}
    for page, what in (
        ("attention", "KNearestAttention"),
        ("attention", "EuclideanAttention"),
        ("key_rule", "DirectionKeys"),
    ):
        exec(part_of(f"write/{page}.md", f"class {what}"), names)
    return names


def memory(attention: mt.Attention, *rule: mt.KeyRule, spread: float = 0.0) -> mt.WorkingMemory:
    """Slots that start alike, or `spread` apart."""
    made = mt.WorkingMemory(4, 6, attention, *rule, context_width=2 if rule else 0)
    if spread:
        draws = [
            randn(*x.shape, seed=i) for i, x in enumerate((made.initial_mu, made.initial_keys))
        ]
        made.store_(MemoryState(0.3 + spread * draws[0], draws[1]))
    return made


def loop(name: str) -> tuple[mt.ClosedLoop, mt.Scenario, mt.Solver | None]:
    arm, moves = mt.TwoLinkArm(), mt.Sinusoid([1.0, 0.3])
    scenario = mt.Scenario(moves, mt.arm_parameters(), 0.4)
    if name == "dragged arm":
        controller = mt.MannController(2, 6, memory(mt.ReallocatingAttention("always")))
        return mt.ClosedLoop(DraggedArm(), controller), scenario, None
    if name == "learned torque":
        return mt.ClosedLoop(arm, LearnedTorque(memory=memory(mt.HardAttention()))), scenario, None
    if name == "waypoints":
        points = torch.tensor([[0.0, 0.0], [0.4, -0.2], [0.1, 0.3]], dtype=torch.float64)
        scenario = mt.Scenario(Waypoints(points, 0.15), mt.arm_parameters(), 0.4)
        return mt.ClosedLoop(arm, mt.MannController(2, 6)), scenario, None
    if name == "k nearest":
        return (
            mt.ClosedLoop(
                arm, mt.MannController(2, 6, memory(printed()["KNearestAttention"](k=2)))
            ),
            scenario,
            None,
        )
    if name == "euclidean on a circle":
        names = printed()
        parts = names["EuclideanAttention"](), names["DirectionKeys"](key_rate=2.0)
        held = memory(*parts, spread=0.2)
        return mt.ClosedLoop(arm, mt.MannController(2, 6, held)), scenario, None
    if name == "heun":
        calm = mt.MannController(2, 6, error_gain=2.0, robust_gain=1.0)
        return mt.ClosedLoop(arm, calm), scenario, Heun(2e-3)
    links = int(name[0])
    attention = mt.ReallocatingAttention("always" if "always" in name else "initial", 0.1)
    controller = mt.MannController(links, 6, memory(attention))
    amplitude = [0.4 / (1 + i) for i in range(links)]
    sizes = torch.linspace(1.0, 0.6, links, dtype=torch.float64)
    parameters = NLinkArm(len(sizes)).parameters_of(masses=sizes, lengths=1.2 * sizes)
    return (
        mt.ClosedLoop(NLinkArm(links), controller),
        mt.Scenario(mt.Sinusoid(amplitude), parameters, 0.4),
        None,
    )


NAMES = ("waypoints", "heun")
SLOW = ("learned torque", "3 links", "dragged arm", "k nearest", "5 links")


@pytest.mark.parametrize(
    "name", [*NAMES, *(pytest.param(name, marks=pytest.mark.slow) for name in SLOW)]
)
def test_own_parts_run_compiled_and_agree_with_torch(name: str) -> None:
    found = []
    for engine in ("torch", "auto"):
        made, scenario, solver = loop(name)
        tensors = [*made.parameters(), *scenario.reference.parameters()]
        free = [p.requires_grad_(True) for p in tensors]
        run = mt.rollout(
            made, scenario, solver, generator=generator(), batch_shape=(2,), engine=engine
        )
        slopes = torch.autograd.grad(mt.srmse(run).sum(), free, allow_unused=True)
        found.append((run, slopes))
    (expected, slopes), (mine, own) = found
    assert (expected.engine, mine.engine) == ("eager", "compiled"), mine.engine_reason
    assert float((mine.q - expected.q).abs().max()) <= 1e-12
    assert float((mine.qd - expected.qd).abs().max()) <= 1e-11
    reached = 0
    for a, b in zip(slopes, own, strict=True):
        a = torch.zeros(()) if a is None else a
        b = torch.zeros(()) if b is None else b
        reached += bool(a.abs().max() > 0)
        assert float((a - b).norm()) <= 1e-10 * max(float(a.norm()), 1e-300)
    assert reached >= 6


@pytest.mark.slow
@pytest.mark.parametrize(
    "name",
    [
        "euclidean on a circle",
        "3 links, always",
        "dragged arm",
    ],
)
def test_events_of_own_parts_are_located_compiled(name: str) -> None:
    """An attention and a key rule of docs/write; a plant of three joints; one with more."""
    found = []
    for engine in ("torch", "auto"):
        made, scenario, solver = loop(name)
        scenario = dataclasses.replace(scenario, horizon=1.0)
        free = [p.requires_grad_(True) for p in made.parameters()]
        run = mt.rollout(
            made, scenario, solver, generator=generator(2), batch_shape=(3,), engine=engine,
            gradient="hybrid",
        )  # fmt: skip
        slopes = torch.autograd.grad(mt.srmse(run).sum(), free, allow_unused=True)
        found.append((run, slopes))
    (expected, slopes), (mine, own) = found
    assert (expected.engine, mine.engine) == ("eager", "compiled"), mine.engine_reason
    assert expected.events is not None and mine.events is not None
    print(name, *(count.tolist() for count in mine.events))
    assert int(expected.events.located.sum()) > 2
    assert all(torch.equal(a, b) for a, b in zip(expected.events, mine.events, strict=True))
    assert float((mine.q - expected.q).abs().max()) <= 1e-11
    for a, b in zip(slopes, own, strict=True):
        assert (a is None) == (b is None or not bool(b.any()))
        if a is not None and b is not None:
            assert float((a - b).norm()) <= 1e-9 * max(float(a.norm()), 1e-300)


def test_a_plants_own_parameter_gets_the_slope_of_differences() -> None:
    made, scenario, _ = loop("dragged arm")
    drag = made.plant.drag

    def loss(values: list[float]) -> Tensor:
        with torch.no_grad():
            drag.copy_(torch.tensor(values, dtype=torch.float64))
        return mt.srmse(mt.rollout(made, scenario, engine="compiled")).sum()

    (slope,) = torch.autograd.grad(loss([0.4, 0.1]), drag)
    with torch.no_grad():
        ends = [loss([0.4 + s * 1e-4, 0.1]) for s in (1, -1)]
    assert math.isclose(float(slope[0]), float(ends[0] - ends[1]) / 2e-4, rel_tol=1e-6)
