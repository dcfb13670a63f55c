"""Plant and controller as one hybrid system: it flows, and it jumps."""

from __future__ import annotations

import torch
from torch import Tensor, nn

from ..checks import instance
from ..control import Controller
from ..errors import ShapeError
from ..functional import as_float64
from ..plants import Plant
from ..plants.plant import Coefficients
from ..signals import Reference, Sampler
from ..trees import map_tensors
from ..types import (
    ControlOutput,
    Linearization,
    LoopState,
    Measurement,
    Mode,
    NetworkState,
    PlantState,
    Proximity,
)
from .scenario import Scenario


class ClosedLoop(nn.Module):
    """A plant under a controller. Between jumps the discrete mode is frozen.

    Raises `KindError` for what is no plant or controller. Design constants stay float64 under
    `.float()` and the like; a part of one's own that does not is refused by `rollout`.
    """

    def __init__(self, plant: Plant, controller: Controller) -> None:
        super().__init__()
        self.plant = instance("plant", plant, Plant)
        self.controller = instance("controller", controller, Controller)

    def initial_state(self, scenario: Scenario, network: NetworkState) -> tuple[LoopState, Mode]:
        """State (..., *event) and mode at t = 0, expanded to the common batch shape.

        Raises `ShapeError` where scenario, constants and weights do not broadcast or sizes do not
        fit, `DomainError` for plant parameters or constants out of range, `DtypeError` for a tensor
        of another precision than float64.
        """
        _check_precision(self, "loop")
        _check_precision(scenario.reference, "reference")
        n = self.plant.n_joints
        if scenario.reference.n_joints != n:
            raise ShapeError(
                f"a plant of {n} joints got a reference of {scenario.reference.n_joints}"
            )
        self.controller.check_network(network)
        if network.W.shape[-1] != n:
            raise ShapeError(f"a plant of {n} joints got a controller of {network.W.shape[-1]}")
        self.plant.check(scenario.parameters)
        for name, schedule in scenario.schedule.items():
            self.plant.check(scenario.parameters._replace(**{name: schedule.values}))
        self.controller.check()
        batches = [leaf.shape[:-k] for leaf, k in zip(network, (2, 1, 2, 1), strict=True)]
        shapes = (scenario.batch_shape, self.controller.batch_shape(), *batches)
        try:
            batch = torch.broadcast_shapes(*shapes)
        except RuntimeError:
            raise ShapeError(
                f"batch shapes of scenario {tuple(shapes[0])}, constants {tuple(shapes[1])} and "
                f"initial weights {[tuple(shape) for shape in batches]} do not broadcast"
            ) from None
        network = NetworkState(
            *(
                leaf.expand(*batch, *leaf.shape[-k:])
                for leaf, k in zip(network, (2, 1, 2, 1), strict=True)
            )
        )
        start = map_tensors(lambda leaf: leaf.expand(*batch, n), scenario.start_state())
        t = torch.zeros((), dtype=torch.float64)
        reference = scenario.reference.expand(batch)(t)
        state, mode = self.controller.initial_state(reference, self.plant.measure(start), network)
        return LoopState(start, state), mode

    def measure(self, state: PlantState, noise: Measurement | None) -> Measurement:
        """What the controller sees of the plant's state: with the sensors' noise, if any."""
        measured = self.plant.measure(state)
        if noise is None:
            return measured
        return Measurement(measured.q + noise.q, measured.qd + noise.qd)

    def observe(
        self,
        t: Tensor,
        state: LoopState,
        mode: Mode,
        reference: Sampler,
        noise: Measurement | None = None,
    ) -> ControlOutput:
        """The controller's torque and signals at times t [s] for saved states (*t.shape, ...)."""
        output: ControlOutput = self.controller(
            reference(t), self.measure(state.plant, noise), state.controller, mode
        )
        return output

    def flow(
        self,
        t: Tensor,
        state: LoopState,
        mode: Mode,
        reference: Sampler,
        coefficients: Coefficients,
        linearize: bool = False,
        noise: Measurement | None = None,
    ) -> tuple[LoopState, Linearization | None]:
        """Time derivative of the state; with `linearize`, also the stiff block.

        `coefficients` are the plant's, from its parameters in force at t.
        """
        sample, measurement = reference(t), self.measure(state.plant, noise)
        output: ControlOutput = self.controller(sample, measurement, state.controller, mode)
        gains = None
        if linearize:
            gains = self.controller.torque_gains(sample, output, state.controller)
        d_plant, block = self.plant.derivative(state.plant, output.torque, coefficients, gains)
        return LoopState(d_plant, output.d_state), block

    def jump(
        self,
        t: Tensor,
        state: LoopState,
        mode: Mode,
        reference: Reference,
        noise: Measurement | None = None,
    ) -> tuple[LoopState, Mode]:
        """The controller's discrete decisions at time t [s]: reallocation of slots."""
        controller, mode = self.controller.jump(
            reference(t), self.measure(state.plant, noise), state.controller, mode
        )
        return LoopState(state.plant, controller), mode

    def proximity(
        self,
        t: Tensor,
        state: LoopState,
        mode: Mode,
        reference: Sampler,
        noise: Measurement | None = None,
    ) -> Proximity:
        """What decides the controller's next event at time t [s]."""
        return self.controller.proximity(
            reference(t), self.measure(state.plant, noise), state.controller, mode
        )

    def reallocate(
        self,
        t: Tensor,
        state: LoopState,
        mode: Mode,
        reference: Sampler,
        due: Tensor,
        noise: Measurement | None = None,
    ) -> tuple[LoopState, Mode]:
        """The controller's reset at time t [s], in the samples `due` (...,) bool."""
        controller, mode = self.controller.reallocate(
            reference(t), self.measure(state.plant, noise), state.controller, mode, due
        )
        return LoopState(state.plant, controller), mode


def _check_precision(module: nn.Module, name: str) -> None:
    """Raise `DtypeError` for a parameter or buffer of another precision: the loop is stiff."""
    for held in (module.named_parameters(), module.named_buffers()):
        for path, tensor in held:
            if tensor.is_floating_point():
                as_float64(tensor, f"{name}.{path}")
