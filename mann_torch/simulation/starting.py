"""Where a rollout starts: every part's state and mode at t = 0, checked and of one batch shape."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from contextlib import suppress
from typing import Any, NamedTuple

import torch
from torch import Tensor, nn

from ..control import Controller
from ..errors import ConfigError, ShapeError
from ..functional import as_float64
from ..signals import Surroundings, noise_at
from ..trees import difference, leaf_paths, leaves, map_tensors
from ..types import LoopMode, LoopState, Snapshot
from .closed_loop import ClosedLoop
from .conditions import Conditions
from .scenario import Scenario


class Start(NamedTuple):
    """Where a rollout starts, every part of the batch shape `...`."""

    state: LoopState
    mode: LoopMode
    surroundings: Surroundings
    measured: Any  # what there is to measure at t = 0


def common_shape(
    loop: ClosedLoop, scenario: Scenario, weights: Any = None, extra: Sequence[int] = ()
) -> torch.Size:
    """Batch shape of all of them together. Raises `ShapeError`."""
    shapes = {
        "scenario": tuple(scenario.batch_shape),
        "constants": tuple(loop.batch_shape()),
        "initial weights": tuple(loop.controller.check_weights(weights)),
        "batch_shape": tuple(extra),
    }
    try:
        return torch.broadcast_shapes(*shapes.values())
    except (RuntimeError, TypeError):
        told = ", ".join(f"{name} {shape}" for name, shape in shapes.items())
        raise ShapeError(f"batch shapes do not broadcast: {told}") from None


def start_of(
    loop: ClosedLoop,
    scenario: Scenario,
    weights: Any = None,
    generator: torch.Generator | None = None,
    batch_shape: Sequence[int] = (),
    begin: Snapshot | None = None,
) -> Start:
    """State (..., *event) and mode at t = 0, expanded to the common batch shape.

    Raises `ConfigError` for a `begin` of another loop, `ShapeError` where scenario, constants and
    weights do not broadcast or sizes do not fit, `DomainError` for plant parameters or constants
    out of range, `DtypeError` for a tensor of another precision than float64.
    """
    if begin is not None:
        scenario = dataclasses.replace(scenario, start=begin.state.plant)
    _check_precision(loop, "loop")
    _check_precision(scenario.surroundings, "scenario")
    _check_sizes(loop, scenario)
    plant = loop.plant
    plant.check(scenario.parameters)
    for name, schedule in scenario.schedule.items():
        plant.check(scenario.parameters._replace(**{name: schedule.values}))
    loop.check()
    batch = common_shape(loop, scenario, weights, batch_shape)
    start = plant.rest() if scenario.start is None else scenario.start
    for path, leaf in zip(leaf_paths(start), leaves(start), strict=True):
        as_float64(leaf, f"the state of {type(plant).__name__}, {path},")
    start = map_tensors(lambda leaf: leaf.expand(*batch, leaf.shape[-1]), start)
    t = torch.zeros((), dtype=torch.float64)
    surroundings = scenario.surroundings.expand(batch)
    here = Conditions(surroundings, coefficients_of(loop, scenario, batch, t))
    outside = here.signals(t)
    widths = [part.shape[-1] for part in plant.measure(start, here.coefficients)]
    _check_measured(loop, scenario, sum(widths))
    model = None
    if loop.model is not None:
        y = plant.output(start, here.coefficients)
        model = loop.model.initial_state(outside.reference, y)
    state, mode = LoopState(start, None, None, model), LoopMode(None)
    seen = loop.seen(state, here, outside.forces)
    if loop.sensor is not None:
        period = None if loop.clock is None else loop.clock.period
        count = loop.sensor.samples(period)[1]
        if scenario.noise is not None:  # what is on its way is the sample at t = 0, noise and all
            first = noise_at(scenario.noise.expand(batch).table(widths, 1), torch.tensor(0))
            noisy = loop.seen(state, here._replace(noise=first), outside.forces)
        else:
            noisy = seen
        flat = torch.cat(list(noisy), dim=-1)
        mode = mode._replace(sensor=loop.sensor.initial_state(flat, count))
    sample = loop.followed(outside, state, here)
    measured = loop.measured(state, mode, here, outside.forces)
    if weights is None and generator is None:
        loop.controller.check_weights(loop.controller.initial_weights(()))  # what is stored
    own, inner = loop.controller.initial_state(sample, measured, batch, generator, weights)
    state, mode = state._replace(controller=own), mode._replace(controller=inner)
    if loop.actuator is not None or loop.clock is not None:
        u = torch.zeros(*batch, len(plant.inputs), dtype=torch.float64)
        if loop.actuator is not None:
            state = state._replace(actuator=loop.actuator.initial_state(u))
        if loop.clock is not None:
            answer = loop.controller(sample, measured, own, inner)
            mode = mode._replace(clock=loop.clock.initial_state(u, own, answer.decay))
    if begin is not None:
        state, mode = _as_begun(begin, Snapshot(state, mode))
    _check_answer(loop, state, mode, here)
    return Start(state, mode, surroundings, seen)


def _as_begun(begin: Snapshot, fresh: Snapshot) -> Snapshot:
    """The snapshot in the batch shape of a fresh start, whose form it must have."""
    found = begin
    with suppress(RuntimeError, TypeError, ValueError):  # other trees, or shapes
        found = map_tensors(lambda leaf, like: leaf.expand(like.shape), begin, fresh)
    told = difference(found, fresh)
    if told is not None:
        raise ConfigError(f"begin is not of this loop, or not of this batch: {told}")
    return found


def coefficients_of(loop: ClosedLoop, scenario: Scenario, batch: torch.Size, t: Tensor) -> Any:
    """The plant's coefficients at times t [s], for the whole batch: (*t.shape, ..., *event)."""
    # Of one time, rows are written out after they are looked up; of more, before: they align.
    moving = {
        name: (rows.expand(batch) if t.dim() else rows).at(t)
        for name, rows in scenario.schedule.items()
    }
    parameters = map_tensors(
        lambda rows: rows.expand(*t.shape, *batch, rows.shape[-1]),
        scenario.parameters._replace(**moving),
    )
    return loop.plant.coefficients(parameters)


def _check_sizes(loop: ClosedLoop, scenario: Scenario) -> None:
    """Raise for a reference, a start or disturbances that are not of the plant's sizes."""
    plant, reference = loop.plant, scenario.reference
    p, needed = len(plant.outputs), loop.controller.reference_order
    if reference.width != p:
        raise ShapeError(f"a plant of {p} outputs got a reference of {reference.width}")
    if loop.model is not None:
        needed = loop.model.command_order
    if reference.order < needed:
        asks = loop.controller if loop.model is None else loop.model
        raise ConfigError(
            f"{type(asks).__name__} asks for {needed} derivatives of its reference, "
            f"{type(reference).__name__} has {reference.order}: take a smoother one, or give the "
            "loop a reference model"
        )
    rest = plant.rest()
    sizes = [leaf.shape[-1] for leaf in leaves(rest)]
    if scenario.start is not None:
        start = scenario.start
        if type(start) is not type(rest):
            raise ConfigError(
                f"start is {type(start).__name__}: the plant's state is {type(rest).__name__}"
            )
        given = [leaf.shape[-1] for leaf in leaves(start)]
        if given != sizes:
            raise ShapeError(f"start has {given} numbers a field: the plant's state has {sizes}")
    if scenario.disturbance is None:
        return
    wanted = {"input": len(plant.inputs), "state": sum(sizes), "plant": len(plant.disturbances)}
    for name, width in scenario.disturbance.widths().items():
        if wanted.get(name, width) != width:
            raise ShapeError(
                f"disturbance on {name} has {width} numbers: the plant takes {wanted[name]}"
            )


def _check_measured(loop: ClosedLoop, scenario: Scenario, width: int) -> None:
    """Raise `ShapeError` for a disturbance or a sensor of another width than what is measured."""
    if loop.sensor is not None:
        loop.sensor.check_fit(width)
    given = {} if scenario.disturbance is None else scenario.disturbance.widths()
    if given.get("output", width) != width:
        raise ShapeError(
            f"disturbance on output has {given['output']} numbers: {width} are measured"
        )


def _check_answer(loop: ClosedLoop, state: LoopState, mode: LoopMode, here: Conditions) -> None:
    """Raise `ShapeError` where the controller's first answer does not fit the plant.

    One that has its own `check_fit` was asked when the loop was made.
    """
    if type(loop.controller).check_fit is not Controller.check_fit:
        return
    with torch.no_grad():
        u = loop.control(torch.zeros((), dtype=torch.float64), state, mode, here).input
    m = len(loop.plant.inputs)
    if u.shape[-1] != m:
        raise ShapeError(
            f"a plant of {m} inputs got {u.shape[-1]} from {type(loop.controller).__name__}"
        )


def _check_precision(module: nn.Module, name: str) -> None:
    """Raise `DtypeError` for a parameter or buffer of another precision: the loop is stiff."""
    for held in (module.named_parameters(), module.named_buffers()):
        for path, tensor in held:
            if tensor.is_floating_point():
                as_float64(tensor, f"{name}.{path}")
