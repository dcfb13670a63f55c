"""What constants are judged on: members, each a scenario with its initial weights and noise."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any, NamedTuple, cast

import torch
from torch import Tensor

from ..checks import NONNEGATIVE, POSITIVE, choice, instance, maybe, named, sizes, text
from ..constraints import DesignModule
from ..functional import as_float64
from ..metrics import input_rate, peak_input, srmse
from ..simulation import ENGINES, ClosedLoop, Outcome, Scenario, Solver, Trajectory, rollout
from ..trees import map_tensors
from .judges import EVERYTHING, TOTALS, Judge, Recording, recording_of, worth


class Score(NamedTuple):
    """What a rollout is judged by, all outputs and inputs together; NaN where it diverged."""

    srmse: Tensor  # (...,) root of the sum of squares over outputs
    rate: Tensor  # (...,) RMS rate of the input, likewise [unit/s]
    peak: Tensor  # (...,) largest |input| of all since `effort_after`


@contextmanager
def constants_at(module: DesignModule, values: Mapping[str, Tensor]) -> Iterator[None]:
    """Set constants, and put back what was there, parameters and all.

    Raises as `initialize`, `KindError`.
    """
    instance("module", module, DesignModule)
    named("values", values, Tensor)
    before = {name: module.constant(name) for name in values}
    owners = {name: module.owner(name) for name in values}
    module.initialize(**{name: value.detach() for name, value in values.items()})
    try:
        yield
    finally:
        for name, parameter in before.items():
            owners[name].register_parameter(name, parameter)


@dataclass(frozen=True)
class Ensemble:
    """B members of one loop: scenario batch (B,), initial weights (B, *event).

    Raises `ConfigError`, `KindError`.
    """

    loop: ClosedLoop
    scenario: Scenario
    weights: Any | None  # initial adaptive weights, as the controller gives them; None: its own
    solver: Solver
    #: Constants that a member has of its own, (B, *event); what is tuned comes before them.
    own: Mapping[str, Tensor] = dataclasses.field(default_factory=dict)
    effort_after: float | None = 10.0  # [s]; None: no effort is measured
    engine: str = "auto"
    device: str = "cpu"

    def __post_init__(self) -> None:
        instance("loop", self.loop, ClosedLoop)
        instance("scenario", self.scenario, Scenario)
        self.loop.controller.check_weights(self.weights)
        instance("solver", self.solver, Solver)
        named("own", self.own, Tensor)
        maybe("effort_after", self.effort_after, NONNEGATIVE)
        choice("engine", self.engine, ENGINES)
        text("device", self.device)

    def __len__(self) -> int:
        return int(self.scenario.batch_shape[0])

    def select(self, members: Sequence[int]) -> Ensemble:
        """Some of the members. Raises `KindError`."""
        chosen = list(sizes("members", members, False, signed=True))
        return dataclasses.replace(
            self,
            scenario=self.scenario.select(chosen),
            weights=map_tensors(lambda leaf: leaf[chosen], self.weights),
            own={name: value[chosen] for name, value in self.own.items()},
        )

    def until(self, horizon: float | None) -> Ensemble:
        """The same members, none longer than `horizon` [s]. Raises `ConfigError`, `KindError`."""
        if maybe("horizon", horizon, POSITIVE) is None:
            return self
        shorter = as_float64(self.scenario.horizon).clamp(max=horizon)
        return dataclasses.replace(
            self, scenario=dataclasses.replace(self.scenario, horizon=shorter)
        )

    def run(
        self,
        values: Mapping[str, Tensor],
        gradient: str = "plain",
        temperature: float | None = None,
        progress: Callable[[int], object] | None = None,
        recording: Recording = EVERYTHING,
    ) -> Trajectory:
        """Roll all members out; values (..., 1 or B, *event) give batch (..., B).

        `recording` says what is kept; what is not is refused (see `Recording`).
        Gradients reach the loop's own parameters: set them free within `constants_at`.
        """
        instance("recording", recording, Recording)
        named("values", values, Tensor)
        own = {name: value for name, value in self.own.items() if name not in values}
        with constants_at(self.loop, own):
            trajectory = rollout(
                self.loop,
                self.scenario,
                self.solver,
                weights=self.weights,
                motion_dt=self.scenario.end if recording.totals_only else recording.motion_dt,
                sample_dt=recording.sample_dt,
                sample_until=0.0 if recording.totals_only else recording.sample_until,
                effort_after=self.effort_after,
                engine=self.engine,
                device=self.device,
                gradient=gradient,
                temperature=temperature if gradient == "soft" else None,
                progress=progress,
            )
        # Typed as the whole, which it is but for what the judge itself has left out.
        return cast(Trajectory, recording.shown(trajectory))

    def scores(
        self, values: Mapping[str, Tensor], progress: Callable[[int], object] | None = None
    ) -> Score:
        """Scores (..., B) under constants (..., 1 or B, *event), without gradients."""
        with torch.no_grad(), constants_at(self.loop, values):
            return score(self.run(values, progress=progress, recording=TOTALS))

    def judged(
        self,
        values: Mapping[str, Tensor],
        judge: Judge,
        progress: Callable[[int], object] | None = None,
    ) -> Tensor:
        """`judge` of the rollouts (..., B), without gradients."""
        with torch.no_grad(), constants_at(self.loop, values):
            recording = recording_of(judge)
            return worth(judge, self.run(values, progress=progress, recording=recording))

    def pathwise(
        self,
        values: Mapping[str, Tensor],
        judge: Judge,
        gradient: str = "plain",
        temperature: float | None = None,
    ) -> tuple[Tensor, dict[str, Tensor]]:
        """`judge` of the rollouts, (B,), and its gradient to each constant, (B, *event).

        `values` are (B, *event): each member has its own, so that each has its own gradient. A
        constant that no gradient reaches gets zeros.
        """
        with torch.enable_grad(), constants_at(self.loop, values):
            free = [self.loop.constant(name).requires_grad_(True) for name in values]
            run = self.run(values, gradient, temperature, recording=recording_of(judge))
            judged = worth(judge, run)
            if not judged.requires_grad:
                return judged, {name: torch.zeros_like(p) for name, p in values.items()}
            found = torch.autograd.grad(judged.sum(), free, allow_unused=True)
        zeros = map(torch.zeros_like, free)
        pairs = zip(values, found, zeros, strict=True)
        return judged.detach(), {name: z if g is None else g for name, g, z in pairs}


def score(trajectory: Outcome) -> Score:
    """All outputs, and all inputs, together."""
    return Score(
        srmse(trajectory).square().sum(dim=-1).sqrt(),
        input_rate(trajectory).square().sum(dim=-1).sqrt(),
        peak_input(trajectory).amax(dim=-1),
    )
