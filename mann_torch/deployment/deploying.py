"""From a controller, or a loop, to what runs on a machine."""

from __future__ import annotations

import torch

from ..checks import POSITIVE, choice, instance, number
from ..control import Controller
from ..errors import ConfigError, ShapeError
from ..parts import Actuator, ReferenceModel
from ..plants import Plant
from ..simulation import ClosedLoop
from .ports import ports_of
from .stepper import Stepper
from .tick import Tick

ENGINES = ("compiled", "torch")
PRECISIONS = (torch.float64, torch.float32)
#: Of a period: what rounding may make of a multiple.
_TIE = 1e-9


def deploy(
    controller: Controller | ClosedLoop,
    period: float | None = None,
    *,
    plant: Plant | None = None,
    model: ReferenceModel | None = None,
    actuator: Actuator | None = None,
    dtype: torch.dtype = torch.float64,
    engine: str = "compiled",
) -> Stepper:
    """The controller as a step at instants `period` [s] apart, in float64 or float32.

    Of a `ClosedLoop` its controller, reference model, limits of the actuator and the clock's period
    are taken, and names and units of its plant; lag, sensor and clock's hold are the machine's own.
    A controller that measures joints needs no `plant`, others take their form from it. `model` and
    `actuator` are those of a loop. The constants must have no batch shape.

    Raises `ConfigError` for a period that is missing, that is not the clock's or whose multiples
    are not the instants at which the controller samples, for what can't be deployed, `ShapeError`
    for parts that do not fit and constants with a batch shape, `DomainError`, `KindError`.
    """
    hold = None
    if isinstance(controller, ClosedLoop):
        if not (plant is None and model is None and actuator is None):
            raise ConfigError("plant, model and actuator are the loop's: give the controller alone")
        loop = controller
        controller, plant, model = loop.controller, loop.plant, loop.model
        actuator, clock = loop.actuator, loop.clock
        hold = None if clock is None else clock.hold
        period = clock.period if period is None and clock is not None else period
        if clock is not None and period != clock.period:
            raise ConfigError(
                f"period = {period} s: the loop's clock has {clock.period} s; leave one out"
            )
    instance("controller", controller, Controller)
    if period is None:
        raise ConfigError("give a period [s]: how often a step is taken")
    period = number("period", period, POSITIVE)
    if hold == "first":
        raise ConfigError("the loop's clock holds on a line: a step gives one command, use zero")
    if dtype not in PRECISIONS:
        raise ConfigError(f"dtype = {dtype}: choose float64 or float32")
    choice("engine", engine, ENGINES)
    for name, part, kind in (
        ("plant", plant, Plant), ("model", model, ReferenceModel), ("actuator", actuator, Actuator),
    ):  # fmt: skip
        if part is not None:
            instance(name, part, kind)
    _check_instants(controller, period, dtype)
    order = controller.reference_order if model is None else model.command_order
    ports = ports_of(controller, plant, order)
    _check_parts(controller, model, actuator, len(ports.input), ports.width)
    if model is not None and ports.output is None:
        raise ConfigError(
            f"the outputs of {type(plant).__name__} are not among what is measured: a reference "
            "model can't follow them there"
        )
    controller.check_weights(controller.initial_weights(()))  # what is stored
    tick = Tick(controller, period, ports, model, _limits(actuator))
    for held in (controller, model, actuator):
        shape = () if held is None else tuple(held.batch_shape())
        if shape:
            raise ShapeError(
                f"constants of {type(held).__name__} have batch shape {shape}: set one value"
            )
    return Stepper(tick, dtype, engine)


def _limits(actuator: Actuator | None) -> Actuator | None:
    """An actuator with limits, None for one without: its lag is the machine's."""
    if actuator is None or not {"lower", "upper"} & set(actuator.domains()):
        return None
    return actuator


def _check_instants(controller: Controller, period: float, dtype: torch.dtype) -> None:
    """Raise `ConfigError` where the controller samples between ticks, or float32 loses its time."""
    for own in controller.periods:
        count = own / period
        if round(count) < 1 or abs(count - round(count)) > _TIE * count:
            raise ConfigError(
                f"period = {period} s: {type(controller).__name__} samples every {own} s, which "
                "must be a whole number of periods"
            )
        if dtype != torch.float64:
            raise ConfigError(
                f"{type(controller).__name__} times its own samples (every {own} s): float32 "
                "loses that time after hours; take float64"
            )


def _check_parts(
    controller: Controller,
    model: ReferenceModel | None,
    actuator: Actuator | None,
    n_inputs: int,
    n_outputs: int,
) -> None:
    """Raise `ShapeError` or `ConfigError` for parts of other sizes."""
    controller.check_fit(n_inputs, n_outputs)
    if actuator is not None and actuator.n_inputs != n_inputs:
        raise ShapeError(f"{n_inputs} inputs got an actuator of {actuator.n_inputs}")
    if model is None:
        return
    if model.width != n_outputs:
        raise ShapeError(f"{n_outputs} outputs got a reference model of {model.width}")
    if model.order < controller.reference_order:
        raise ConfigError(
            f"{type(controller).__name__} asks for {controller.reference_order} derivatives of its "
            f"reference, {type(model).__name__} has {model.order}"
        )
