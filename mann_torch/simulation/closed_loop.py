"""Plant, controller and what stands between them as one hybrid system: it flows, and it jumps."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

import torch
from torch import Tensor, nn

from ..checks import instance
from ..constraints import DesignModule
from ..control import Controller
from ..errors import ConfigError, ShapeError
from ..parts import Actuator, Clock, ReferenceModel, Sensor
from ..plants import Plant
from ..signals import Forces, Outside
from ..trees import leaves, map_tensors
from ..types import ControlOutput, LoopMode, LoopState, Proximity, ReferenceSample
from .conditions import Conditions
from .lagged import AnyBlock, Lag, lagged


class Observation(NamedTuple):
    """What a loop shows of itself at saved states, each (K, ..., .)."""

    input: Tensor  # (..., m) what the controller commands
    applied: Tensor  # (..., m) what the plant gets of it, disturbance included
    output: Tensor  # (..., p) what is to follow the reference
    reference: ReferenceSample  # what the controller follows
    measurement: Any  # what the controller sees
    signals: Any  # the controller's own


class ClosedLoop(DesignModule):
    """A plant under a controller. Between jumps the discrete mode is frozen.

    The loop's own parts are each None where there is none, and then cost nothing: an `actuator`
    between the controller's input and the plant's, a `sensor` that samples what is measured, a
    `clock` at whose ticks alone the controller runs, and a reference `model` that the controller
    follows in place of the reference itself.

    Design constants of all parts are found by name (`constants`, `tune`). They stay float64 under
    `.float()` and the like; a part of one's own that does not is refused by `rollout`. Raises
    `KindError` for a part of another kind, `ConfigError` or `ShapeError` for parts that do not fit.
    """

    def __init__(
        self,
        plant: Plant,
        controller: Controller,
        actuator: Actuator | None = None,
        sensor: Sensor | None = None,
        clock: Clock | None = None,
        model: ReferenceModel | None = None,
    ) -> None:
        super().__init__()
        self.plant = instance("plant", plant, Plant)
        self.controller = instance("controller", controller, Controller)
        m, p = len(self.plant.inputs), len(self.plant.outputs)
        self.controller.check_fit(m, p)
        if actuator is not None and instance("actuator", actuator, Actuator).n_inputs != m:
            raise ShapeError(f"a plant of {m} inputs got an actuator of {actuator.n_inputs}")
        if model is not None and instance("model", model, ReferenceModel).width != p:
            raise ShapeError(f"a plant of {p} outputs got a reference model of {model.width}")
        self.actuator, self.sensor, self.clock, self.model = actuator, sensor, clock, model
        period = None if clock is None else instance("clock", clock, Clock).period
        if sensor is not None:
            instance("sensor", sensor, Sensor).samples(period)
        offered = None if model is None else model.order
        if offered is not None and offered < controller.reference_order:
            raise ConfigError(
                f"{type(controller).__name__} asks for {controller.reference_order} derivatives of "
                f"its reference, {type(model).__name__} has {offered}"
            )

    def _apply(self, fn: Callable[[Tensor], Tensor], recurse: bool = True) -> Any:
        # Each part decides what becomes of its tensors; the loop holds none itself.
        return nn.Module._apply(self, fn, recurse)

    @property
    def samples(self) -> bool:
        """Whether the controller's input, or what it sees, is held from instant to instant."""
        return self.clock is not None or self.sensor is not None

    @property
    def jumps_state(self) -> bool:
        """Whether a jump can change the continuous state."""
        return self.controller.reallocates or self.clock is not None

    def seen(self, state: LoopState, here: Conditions, forces: Forces | None) -> Any:
        """What there is to measure of the plant's state, disturbed and with noise."""
        measured = self.plant.measure(state.plant, here.coefficients)
        for added in (None if forces is None else forces.output, here.noise):
            if added is not None:
                widths = [part.shape[-1] for part in measured]
                parts = added.split(widths, dim=-1)
                measured = type(measured)(*map(torch.add, measured, parts))
        return measured

    def measured(
        self, state: LoopState, mode: LoopMode, here: Conditions, forces: Forces | None
    ) -> Any:
        """What the controller sees: with a sensor, what that gives out."""
        fresh = self.seen(state, here, forces)
        if self.sensor is None or mode.sensor is None:
            return fresh
        parts = self.sensor.output(mode.sensor).split([x.shape[-1] for x in fresh], dim=-1)
        return type(fresh)(*parts)

    def followed(self, outside: Outside, state: LoopState, here: Conditions) -> ReferenceSample:
        """What the controller follows: the reference, or the model's output."""
        if self.model is None:
            return outside.reference
        output = self.plant.output(state.plant, here.coefficients)
        return self.model.sample(outside.reference, output, state.model)

    def error(self, t: Tensor, state: LoopState, here: Conditions) -> tuple[Tensor, Tensor]:
        """Tracking error and what is followed, each (..., p), at time t [s]."""
        wanted = self.followed(here.signals(t), state, here).value
        return wanted - self.plant.output(state.plant, here.coefficients), wanted

    def control(
        self, t: Tensor, state: LoopState, mode: LoopMode, here: Conditions
    ) -> ControlOutput:
        """The controller's answer at times t [s] to states (*t.shape, ...)."""
        outside = here.within(t)
        output: ControlOutput = self.controller(
            self.followed(outside, state, here),
            self.measured(state, mode, here, outside.forces),
            state.controller,
            mode.controller,
        )
        return output

    def commanded(self, t: Tensor, state: LoopState, mode: LoopMode, here: Conditions) -> Tensor:
        """The input in force at time t [s], (..., m), before the actuator."""
        if self.clock is None or mode.clock is None:
            return self.control(t, state, mode, here).input
        return self.clock.command(t, mode.clock)

    def observe(self, t: Tensor, state: LoopState, mode: LoopMode, here: Conditions) -> Observation:
        """Inputs, output, reference and signals at times t [s] for states (*t.shape, ...)."""
        outside, answer = here.signals(t), self.control(t, state, mode, here)
        u = answer.input
        if self.clock is not None and mode.clock is not None:
            u = self.clock.command(t.reshape(t.shape + (1,) * (u.dim() - 1 - t.dim())), mode.clock)
        return Observation(
            input=u,
            applied=self._applied(u, state, outside.forces)[0],
            output=self.plant.output(state.plant, here.coefficients),
            reference=self.followed(outside, state, here),
            measurement=self.measured(state, mode, here, outside.forces),
            signals=answer.signals,
        )

    def _applied(
        self, u: Tensor, state: LoopState, forces: Forces | None
    ) -> tuple[Tensor, Tensor | None]:
        """What the plant gets of a command u (..., m), and the actuator's rate."""
        rate = None
        if self.actuator is not None:
            u, rate = self.actuator(u, state.actuator)
        if forces is not None and forces.input is not None:
            u = u + forces.input
        return u, rate

    def flow(
        self,
        t: Tensor,
        state: LoopState,
        mode: LoopMode,
        here: Conditions,
        linearize: bool = False,
    ) -> tuple[LoopState, AnyBlock | None]:
        """Time derivative of the state; with `linearize`, also the stiff block, if there is one."""
        outside = here.within(t)
        forces, gains = outside.forces, None
        if self.clock is None or mode.clock is None:
            sample = self.followed(outside, state, here)
            measurement = self.measured(state, mode, here, forces)
            output: ControlOutput = self.controller(
                sample, measurement, state.controller, mode.controller
            )
            u, d_controller = output.input, output.d_state
            if linearize and self.sensor is None:
                gains = self.controller.input_gains(sample, output, state.controller)
                if self.actuator is not None:
                    gains = self.actuator.passed(u, gains)
        else:
            u = self.clock.command(t, mode.clock)
            d_controller = map_tensors(torch.zeros_like, state.controller)
        applied, d_actuator = self._applied(u, state, forces)
        wind = None if forces is None else forces.plant
        given = (t, state.plant, self.plant.grouped(applied), wind, here.coefficients)
        block: AnyBlock | None = None
        if linearize and self.actuator is not None and d_actuator is not None:
            lag = Lag(self.actuator.pull(u, state.actuator), gains)
            d_plant, block = lagged(partial(self.plant.linearized, *given), lag, state.model)
        elif linearize:
            d_plant, block = self.plant.linearized(*given, gains)
        else:
            d_plant = self.plant.derivative(*given)
        if forces is not None and forces.state is not None:
            parts = forces.state.split([x.shape[-1] for x in leaves(d_plant)], dim=-1)
            d_plant = type(d_plant)(*map(torch.add, d_plant, parts))
        d_model = None
        if self.model is not None:
            y = self.plant.output(state.plant, here.coefficients)
            d_model = self.model.rates(outside.reference, y, state.model)
        return LoopState(d_plant, d_controller, d_actuator, d_model), block

    def proximity(self, t: Tensor, state: LoopState, mode: LoopMode, here: Conditions) -> Proximity:
        """What decides the controller's next event at time t [s]."""
        outside = here.within(t)
        sample = self.followed(outside, state, here)
        measurement = self.measured(state, mode, here, outside.forces)
        return self.controller.proximity(sample, measurement, state.controller, mode.controller)

    def reallocate(
        self, t: Tensor, state: LoopState, mode: LoopMode, here: Conditions, due: Tensor
    ) -> tuple[LoopState, LoopMode]:
        """The controller's reset at time t [s], in the samples `due` (...,) bool."""
        outside = here.within(t)
        sample = self.followed(outside, state, here)
        measurement = self.measured(state, mode, here, outside.forces)
        own, inner = self.controller.reallocate(
            sample, measurement, state.controller, mode.controller, due
        )
        return state._replace(controller=own), mode._replace(controller=inner)
