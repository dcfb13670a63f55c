"""What a controller is checked with: a plant that it fits, samples of a reference, states."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

import torch
from torch import Tensor

from ..control import Controller
from ..errors import ConfigError, InterfaceError, ShapeError
from ..parts import ReferenceModel, SecondOrderModel
from ..plants import DoubleIntegrator, LinearPlant, Plant, Regression, TwoLinkArm
from ..signals import Reference, Sinusoid
from ..telling import explained
from ..trees import map_tensors
from ..types import ControlOutput, ReferenceSample
from .functions import SAMPLES
from .plant_bench import bench
from .samples import drawn_sample
from .telling import broken

#: Plants that a controller is tried on where none is given.
PLANTS: tuple[Callable[[], Plant], ...] = (
    TwoLinkArm,
    DoubleIntegrator,
    partial(LinearPlant, [[-1.0]], [[1.0]], [[1.0]]),
    partial(LinearPlant, [[0.0, 1.0], [-1.0, -2.0]], [[0.0], [1.0]], [[1.0, 0.0]], "state"),
    Regression,
)
#: Steps, and their length [s], on the way from t = 0.
STEPS, STEP = 4, 0.01


class Asked(NamedTuple):
    """What a controller is asked with."""

    reference: ReferenceSample  # (SAMPLES, p), with `reference_order` derivatives
    measurement: Any  # (SAMPLES, *)
    state: Any
    mode: Any


class ControllerBench(NamedTuple):
    """A controller, a plant that it fits, and what it follows there."""

    controller: Controller
    plant: Plant
    signal: Reference
    model: ReferenceModel | None
    reference: ReferenceSample
    measurement: Any

    def at_start(self, generator: torch.Generator | None = None) -> Asked:
        """State and mode at t = 0."""
        state, mode = self.controller.initial_state(
            self.reference, self.measurement, (SAMPLES,), generator
        )
        return Asked(self.reference, self.measurement, state, mode)

    def moved(self) -> Asked:
        """Some steps on: state and mode that are none of t = 0."""
        generator = torch.Generator().manual_seed(0)
        asked = self.at_start(generator)

        def unlike(x: Tensor) -> Tensor:
            # What starts equal, slots say, is not compared as equal.
            return x * (1.0 + 0.01 * torch.randn(x.shape, generator=generator, dtype=x.dtype))

        asked = asked._replace(state=map_tensors(unlike, asked.state))
        for _ in range(STEPS):
            state, mode = self.controller.jump(*asked)
            d_state = answer(self.controller, asked._replace(state=state, mode=mode)).d_state
            state = map_tensors(_step, state, d_state)
            asked = asked._replace(state=state, mode=mode)
        return asked

    @property
    def n_measured(self) -> int:
        """Numbers that are measured, Y."""
        return sum(part.shape[-1] for part in self.measurement)


def _step(x: Tensor, dx: Tensor) -> Tensor:
    return x + STEP * dx


def answer(controller: Any, asked: Asked) -> ControlOutput:
    """Of one evaluation."""
    found: ControlOutput = controller(*asked)
    return found


def bench_of(
    controller: Controller,
    plant: Plant | None,
    reference: Reference | None,
    model: ReferenceModel | None,
) -> ControllerBench:
    """A bench on the plant given, or on the first that fits.

    Raises `ShapeError`, `ConfigError` or `InterfaceError`.
    """
    if plant is not None:
        controller.check_fit(len(plant.inputs), len(plant.outputs))
        fitting = [plant]
    else:
        fitting = [made for made in (make() for make in PLANTS) if _fits(controller, made)]
        for part in (reference, model):
            if part is not None:
                fitting = [p for p in fitting if len(p.outputs) == part.width] or fitting
    benches = [_on(controller, each, reference, model) for each in fitting]
    if model is None and controller.reference_order <= SecondOrderModel.order:
        # One that asks for a command is to follow a model.
        models = [SecondOrderModel(len(each.outputs), 3.0) for each in fitting]
        both = zip(fitting, models, strict=True)
        benches += [_on(controller, each, reference, own) for each, own in both]
    errors = list(map(_error, benches))
    # One that refuses what it is given does not fit; one that fails is what is to be told.
    refused = [isinstance(e, ConfigError) and not isinstance(e, InterfaceError) for e in errors]
    for wanted in (lambda i: errors[i] is None, lambda i: not refused[i]):
        for i, found in enumerate(benches):
            if wanted(i):
                return found
    if plant is not None and errors[0] is not None:
        raise errors[0]
    why = f" ({explained(errors[0])})" if errors and errors[0] is not None else ""
    raise ConfigError(
        f"plant = None: {type(controller).__name__} fits none of the plants that are tried{why}; "
        "give one that it controls"
    )


def _fits(controller: Controller, plant: Plant) -> bool:
    try:
        controller.check_fit(len(plant.inputs), len(plant.outputs))
    except ConfigError:
        return False
    except Exception as error:
        mend = "raise a ShapeError, or nothing"
        raise broken(controller, 4, f"check_fit fails; {explained(error)}", mend) from error
    return True


def _error(found: ControllerBench) -> Exception | None:
    """What keeps the controller from answering with as many inputs as the plant has."""
    m = len(found.plant.inputs)
    try:
        u = answer(found.controller, found.at_start()).input
    except Exception as error:
        return error
    return None if u.shape[-1:] == (m,) else RuntimeError(f"input of shape {tuple(u.shape)}")


def _on(
    controller: Controller,
    plant: Plant,
    reference: Reference | None,
    model: ReferenceModel | None,
) -> ControllerBench:
    p, order = len(plant.outputs), controller.reference_order
    signal = Sinusoid([1.0] * p, 0.5) if reference is None else reference
    if signal.width != p or signal.batch_shape != ():
        raise ShapeError(
            f"reference of width {signal.width} and batch shape {tuple(signal.batch_shape)}: the "
            f"plant has {p} outputs, and no batch is wanted"
        )
    if model is not None and model.width != p:
        raise ShapeError(f"model of width {model.width}: the plant has {p} outputs")
    if model is None and signal.order < order:
        raise ConfigError(
            f"reference has {signal.order} derivatives, {type(controller).__name__} asks for "
            f"{order}: give a smoother one"
        )
    generator = torch.Generator().manual_seed(2)
    if reference is None or model is not None:
        sample = drawn_sample(p, order, generator)
    else:
        t = 10.0 * torch.rand(SAMPLES, generator=generator, dtype=torch.float64)
        sample = ReferenceSample(*signal(t).upto(order))
    if model is not None:
        state = model.initial_state(sample, sample.value)
        state = torch.randn(state.shape, generator=generator, dtype=state.dtype)
        sample = sample._replace(command=drawn_sample(p, 0, generator).value, state=state)
    b = bench(plant, plant.parameters_of(), None)
    return ControllerBench(
        controller, plant, signal, model, sample, plant.measure(b.state, b.coefficients)
    )
