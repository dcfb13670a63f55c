"""What is asked of the closed loop: reference, plant parameters, jumps, horizon."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import torch
from torch import Tensor

from ..checks import instance, named, several, sizes, text, wrong
from ..errors import ConfigError, ShapeError
from ..functional import as_float64
from ..plants.plant import Parameters
from ..signals import Disturbance, MeasurementNoise, PiecewiseConstant, Reference, Surroundings
from ..trees import leaves, map_tensors


def _expand(leaf: Tensor, batch: torch.Size, event_dims: int) -> Tensor:
    return leaf.expand(*batch, *leaf.shape[-event_dims:])


def _check_tensors(name: str, tree: Parameters) -> None:
    """Raise `KindError` or `DtypeError` for a leaf that is no tensor, or no float64 one."""
    for field_name, leaf in zip(tree._fields, tree, strict=True):
        path = f"{name}.{field_name}"
        if hasattr(leaf, "_fields"):
            _check_tensors(path, leaf)
        elif leaf is not None and instance(path, leaf, Tensor).is_floating_point():
            as_float64(leaf, path)


@dataclass(frozen=True)
class Scenario:
    """One task or a batch of tasks; every member may carry leading batch dimensions `...`.

    `schedule` names fields of the plant's parameters (``masses``) that jump in time. `horizon`
    [s] is a number or a tensor (...,): a sample's metrics stop at its own. `start` is the plant's
    state at t = 0, at rest if not given. `noise` is what the sensors add, `disturbance` what else
    acts on the loop from outside.

    Raises `ConfigError` for a horizon that is not finite and > 0 or a schedule of an unknown
    field, `ShapeError` where batch shapes do not broadcast, `KindError` or `DtypeError` for a part
    of a wrong type.
    """

    reference: Reference
    parameters: Parameters
    horizon: float | Tensor
    schedule: Mapping[str, PiecewiseConstant] = field(default_factory=dict)
    start: Any = None  # a NamedTuple like the plant's state
    noise: MeasurementNoise | None = None
    disturbance: Disturbance | None = None
    name: str = "scenario"

    def __post_init__(self) -> None:
        object.__setattr__(self, "horizon", as_float64(self.horizon, "horizon"))
        self.check()

    def check(self) -> None:
        """Raise, as on making, for parts that do not fit (any more): tensors can be written to."""
        text("name", self.name)
        instance("reference", self.reference, Reference)
        if not hasattr(self.parameters, "_fields"):
            raise wrong("parameters", self.parameters, "a NamedTuple of tensors, one row a sample")
        _check_tensors("parameters", self.parameters)
        horizon = as_float64(self.horizon, "horizon")
        if not bool((torch.isfinite(horizon) & (horizon > 0)).all()):
            raise ConfigError(f"horizon = {horizon.tolist()}: must be finite and > 0")
        for name, schedule in named("schedule", self.schedule, PiecewiseConstant).items():
            schedule.check(f"schedule of '{name}':")
            if name not in self.parameters._fields:
                raise ConfigError(
                    f"schedule of '{name}': the plant has {', '.join(self.parameters._fields)}"
                )
        if self.noise is not None:
            instance("noise", self.noise, MeasurementNoise).check()
        if self.disturbance is not None:
            instance("disturbance", self.disturbance, Disturbance)
        if self.start is not None:
            if not hasattr(self.start, "_fields"):
                raise wrong("start", self.start, "a NamedTuple like the plant's state")
            for leaf in self.start:
                rows = as_float64(instance("start", leaf, Tensor), "start")
                if rows.dim() < 1:
                    raise ShapeError("start of shape (): give a row of numbers a field")
                if not bool(torch.isfinite(rows).all()):
                    raise ConfigError(f"start = {leaf.tolist()}: must be finite")
        try:
            _ = self.batch_shape
        except RuntimeError as error:
            raise ShapeError(f"scenario '{self.name}': {error}") from None

    @property
    def batch_shape(self) -> torch.Size:
        """Leading batch dimensions `...` of all parts together."""
        shapes = [self.reference.batch_shape, as_float64(self.horizon).shape]
        shapes += [leaf.shape[:-1] for leaf in leaves(self.parameters)]
        shapes += [schedule.batch_shape for schedule in self.schedule.values()]
        if self.start is not None:
            shapes += [leaf.shape[:-1] for leaf in self.start]
        shapes += [part.batch_shape for part in (self.noise, self.disturbance) if part is not None]
        return torch.broadcast_shapes(*shapes)

    @cached_property
    def surroundings(self) -> Surroundings:
        """Reference and disturbance together: all that acts on a loop from outside."""
        return Surroundings(self.reference, self.disturbance)

    @property
    def end(self) -> float:
        """The longest horizon of the batch [s]."""
        return float(as_float64(self.horizon).max())

    def knots(self) -> list[float]:
        """Jump times of all samples, sorted [s]."""
        times = {t for schedule in self.schedule.values() for t in schedule.knots()}
        return sorted(times)

    def parameters_at(self, t: Tensor) -> Parameters:
        """Plant parameters in force at times t [s]."""
        moving = {name: schedule.at(t) for name, schedule in self.schedule.items()}
        return self.parameters._replace(**moving)

    def expanded(self) -> Scenario:
        """The same scenario with every part expanded to the common batch shape."""
        batch = self.batch_shape
        return replace(
            self,
            reference=self.reference.expand(batch),
            parameters=map_tensors(lambda leaf: _expand(leaf, batch, 1), self.parameters),
            horizon=as_float64(self.horizon).expand(batch),
            schedule={name: s.expand(batch) for name, s in self.schedule.items()},
            start=map_tensors(lambda leaf: _expand(leaf, batch, 1), self.start),
            noise=None if self.noise is None else self.noise.expand(batch),
            disturbance=None if self.disturbance is None else self.disturbance.expand(batch),
        )

    def select(self, members: Sequence[int]) -> Scenario:
        """Some members of the first batch dimension. Raises `KindError`."""
        rows, full = list(sizes("members", members, False, signed=True)), self.expanded()
        return replace(
            full,
            reference=full.reference.select(rows),
            parameters=map_tensors(lambda leaf: leaf[rows], full.parameters),
            horizon=as_float64(full.horizon)[rows],
            schedule={name: s.select(rows) for name, s in full.schedule.items()},
            start=map_tensors(lambda leaf: leaf[rows], full.start),
            noise=None if full.noise is None else full.noise.select(rows),
            disturbance=None if full.disturbance is None else full.disturbance.select(rows),
        )

    @staticmethod
    def stack(scenarios: Sequence[Scenario], name: str = "batch") -> Scenario:
        """One scenario with a new leading batch dimension, a row per given scenario.

        All must be of the same batch shape, the same kind of reference and the same scheduled
        fields, all with noise, disturbance and a start, or none. Raises `ConfigError` otherwise.
        """
        scenarios = several("scenarios", scenarios, Scenario)
        kinds = {
            (
                type(s.reference),
                tuple(sorted(s.schedule)),
                type(s.parameters),
                s.batch_shape,
                *(part is None for part in (s.start, s.noise, s.disturbance)),
            )
            for s in scenarios
        }
        if len(kinds) != 1:
            raise ConfigError(
                "scenarios to stack must be at least one, with the same kind of reference and "
                "parameters, the same scheduled fields and the same batch shape, all with noise, "
                "disturbance and a start, or none"
            )
        scenarios = [s.expanded() for s in scenarios]
        first = scenarios[0]
        rows = [scenario.parameters for scenario in scenarios]
        noises = [s.noise for s in scenarios if s.noise is not None]
        winds = [s.disturbance for s in scenarios if s.disturbance is not None]
        return Scenario(
            reference=first.reference.stack([s.reference for s in scenarios]),
            parameters=map_tensors(lambda *t: torch.stack(t), *rows),
            horizon=torch.stack([as_float64(s.horizon) for s in scenarios]),
            schedule={
                key: PiecewiseConstant.stack([s.schedule[key] for s in scenarios])
                for key in first.schedule
            },
            start=map_tensors(lambda *t: torch.stack(t), *[s.start for s in scenarios]),
            noise=MeasurementNoise.stack(noises) if noises else None,
            disturbance=winds[0].stack(winds) if winds else None,
            name=name,
        )
