"""Gradient modes by name: what each is exact for, and what it costs."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import torch
from torch import Tensor

from ..checks import POSITIVE, WITHIN_2, choice, function, instance, number, several, whole
from ..errors import ConfigError
from .coordinates import Coordinates
from .ensemble import Ensemble
from .judges import Judge
from .slopes import DESIGNS, Slope, differences, smoothed

#: Modes that differentiate through a rollout: names of `rollout(gradient=...)`.
PATHWISE = ("plain", "hybrid", "soft")
MODES = (*PATHWISE, "smoothed", "fd")


@dataclass(frozen=True)
class GradientSettings:
    """A mode and its settings.

    | mode | exact for | cost in forward rollouts a member |
    |---|---|---|
    | plain | the present sequence of switches and resets, their times held still | about 4 |
    | hybrid | isolated switches and resets, whose times it moves; sliding averaged | about 7 |
    | soft | the relaxed controller of `temperature`, not the hard one | about 4 |
    | smoothed | the mean over members and a relative `spread` | 2 `pairs`, times P if ``each`` |
    | fd | the mean slope over +- `step` | 2 P |

    `pairs` not given: 3 by ``each``; by ``joint`` enough for 2.5 comparisons a coordinate.
    `temperature` falls geometrically to `final_temperature` over a tuning run. `control`: names of
    constants whose plain gradient is right: it serves `smoothed` as a control variate.

    Raises `ConfigError` for a setting out of range, `KindError`.
    """

    mode: str = "smoothed"
    spread: float = 0.126
    pairs: int | None = None
    design: str = "joint"
    control: Sequence[str] = ()
    step: float = 0.1
    temperature: float = 0.02
    final_temperature: float = 0.002

    def __post_init__(self) -> None:
        choice("gradient mode", self.mode, MODES)
        choice("gradient design", self.design, DESIGNS)
        for name in ("spread", "step"):
            number(f"gradient {name}", getattr(self, name), WITHIN_2)
        for name in ("temperature", "final_temperature"):
            number(f"gradient {name}", getattr(self, name), POSITIVE)
        if self.pairs is not None:
            whole("gradient pairs", self.pairs)
        several("gradient control", self.control, str)

    def check(self, members: int, coordinates: Coordinates, minibatch: int | None = None) -> None:
        """Raise `ConfigError` for what can't work."""
        for name in self.control:
            if name not in coordinates.names:
                raise ConfigError(
                    f"gradient control: '{name}' is not tuned; "
                    f"choose from {', '.join(coordinates.names)}"
                )
        size = min(members, minibatch or members)
        joint = self.mode == "smoothed" and self.design == "joint"
        pairs = self.pairs_for(size, coordinates.size)
        if joint and size * pairs <= coordinates.size:
            raise ConfigError(
                f"{size} members x {pairs} pairs can't tell {coordinates.size} coordinates "
                "apart: more gradient.pairs, or gradient.design=each"
            )

    def pairs_for(self, members: int, coordinates: int) -> int:
        """Pairs of copies a member."""
        if self.pairs is not None:
            return self.pairs
        return 3 if self.design == "each" else math.ceil(2.5 * coordinates / members)

    def copies_for(self, members: int, coordinates: int) -> int:
        """Copies of each member that run side by side."""
        if self.mode in PATHWISE:
            return 1
        every = 2 if self.mode == "smoothed" and self.design == "joint" else 2 * coordinates
        return every * (1 if self.mode == "fd" else self.pairs_for(members, coordinates))

    def temperature_at(self, progress: float) -> float:
        """The temperature when a share `progress` (0 to 1) of the run is done."""
        ratio = self.final_temperature / self.temperature
        return self.temperature * ratio**progress


def slope_of(
    ensemble: Ensemble,
    coordinates: Coordinates,
    z: Tensor,
    judge: Judge,
    settings: GradientSettings,
    generator: torch.Generator | None = None,
    progress: float = 0.0,
) -> Slope:
    """The slope of the members' mean objective at z (P,) by the chosen mode.

    `judge` turns rollouts into the objective (..., B); it may declare what it reads (`Judged`).
    What a sample that diverged is worth is for it to say: there, motion stays at the last state.

    Raises `ConfigError`, `KindError`.
    """
    _check(ensemble, coordinates, z, judge)
    instance("settings", settings, GradientSettings)
    if generator is not None:
        instance("generator", generator, torch.Generator)
    progress = number("progress", progress)

    def values(points: Tensor) -> Tensor:
        return ensemble.judged(coordinates.values(points), judge)

    members = len(ensemble)
    if settings.mode == "fd":
        return differences(values, z, members, settings.step)
    if settings.mode == "smoothed":
        control = None
        if settings.control:
            exact, _ = pathwise_slopes(ensemble, coordinates, z, judge, "plain")
            control = control_of(exact, coordinates, settings.control)
        return smoothed(
            values,
            z,
            members,
            spread=settings.spread,
            pairs=settings.pairs_for(members, len(z)),
            design=settings.design,
            generator=generator,
            control=control,
        )
    slopes, value = pathwise_slopes(
        ensemble, coordinates, z, judge, settings.mode, settings.temperature_at(progress)
    )
    return Slope.of_members(slopes, value)


def control_of(exact: Tensor, coordinates: Coordinates, names: Sequence[str]) -> Tensor:
    """Plain slopes (B, P) of the named constants, NaN for the others. Raises `KindError`."""
    instance("exact", exact, Tensor)
    instance("coordinates", coordinates, Coordinates)
    several("names", names, str)
    known = torch.tensor([label.split("[")[0] in names for label in coordinates.labels])
    return torch.where(known, exact, torch.nan)


def pathwise_slopes(
    ensemble: Ensemble,
    coordinates: Coordinates,
    z: Tensor,
    judge: Judge,
    mode: str,
    temperature: float | None = None,
) -> tuple[Tensor, float]:
    """Each member's own gradient along the coordinates (B, P), and the mean objective.

    Raises `ConfigError`, `KindError`.
    """
    _check(ensemble, coordinates, z, judge)
    choice("mode", mode, PATHWISE)
    own = z.expand(len(ensemble), -1).clone().requires_grad_(True)
    with torch.enable_grad():
        values = coordinates.values(own)
    judged, found = ensemble.pathwise(values, judge, mode, temperature)
    (slopes,) = torch.autograd.grad(list(values.values()), own, [found[name] for name in values])
    return slopes, float(judged.mean())


def _check(ensemble: Ensemble, coordinates: Coordinates, z: Tensor, judge: Judge) -> None:
    instance("ensemble", ensemble, Ensemble)
    instance("coordinates", coordinates, Coordinates)
    instance("z", z, Tensor)
    function("judge", judge)
