"""Loops, tasks and constants that reach every branch of the equations."""

from __future__ import annotations

import dataclasses
from typing import NamedTuple

import torch
from torch import Tensor

import mann_torch as mt
from mann_torch.types import MemoryState, NetworkState, PlantState
from tests.conftest import generator, make_controller, randn

#: Controllers, with every attention, key rule and phase.
NAMES = (
    "nn",
    "soft",
    "soft_state_keys",
    "hard",
    "hard_state_keys",
    "reallocating_initial",
    "reallocating_initial_state_keys",
    "reallocating_always",
    "reallocating_always_state_keys",
    "relaxed_hard",
    "relaxed_hard_state_keys",
    "relaxed_initial",
    "relaxed_initial_state_keys",
    "relaxed_always",
    "relaxed_always_state_keys",
)
#: Nothing is zero, nothing is one.
CONSTANTS = {
    "error_gain": [[5.0, 0.3], [0.3, 4.0]],
    "base_gain": 18.0,
    "robust_gain": 9.0,
    "weight_bound": 0.2,
    "rate_W": 11.0,
    "rate_V": 8.0,
    "e_modification": 0.07,
    "write_gain": 0.7,
    "shift_threshold": 0.15,
    "key_rate": 1.3,
    "temperature": 0.04,
}


class Case(NamedTuple):
    """A loop with a task and initial weights; every tensor may require grad."""

    loop: mt.ClosedLoop
    scenario: mt.Scenario
    weights: NetworkState

    def run(self, **arguments: object) -> mt.Trajectory:
        """Roll it out."""
        return mt.rollout(self.loop, self.scenario, weights=self.weights, **arguments)


def case(name: str, horizon: float, batch: int = 3, reset: str = "scaled") -> Case:
    """A case far from rest: random weights, a stored random memory, friction, mass jumps."""
    controller = make_controller(name)
    known = controller.constants()
    controller.initialize(**{key: value for key, value in CONSTANTS.items() if key in known})
    if controller.memory is not None:
        memory = controller.memory
        memory.reset = reset
        keys = randn(*memory.initial_keys.shape, seed=3)
        slots = torch.arange(memory.n_slots)
        used = slots < 2 if memory.attention.reallocates else slots != 2
        memory.store_(MemoryState(0.3 + 0.2 * randn(*memory.initial_mu.shape, seed=2), keys), used)
    network = controller.initial_weights((batch,), generator(1))
    network = NetworkState(*(leaf + 0.3 * randn(*leaf.shape, seed=4) for leaf in network))
    scenario = mt.Scenario(
        reference=mt.Sinusoid([1.0, 0.3], [0.5, 0.7], [0.1, -0.2]),
        parameters=mt.arm_parameters([0.8, 2.3], [1.0, 1.1], [0.3, 0.2], [0.2, 0.0]),
        horizon=horizon,
        schedule={
            "masses": mt.PiecewiseConstant(
                [0.3 * horizon, 0.7 * horizon], [[0.8, 2.3], [0.5, 1.2], [1.1, 2.9]]
            )
        },
        start=PlantState(randn(batch, 2, seed=5), randn(batch, 2, seed=6)),
    )
    return Case(mt.ClosedLoop(mt.TwoLinkArm(), controller), scenario, network)


def freed(made: Case) -> tuple[Case, dict[str, Tensor]]:
    """The same case with everything that a gradient may reach set free, by name."""
    controller = made.loop.controller
    free: dict[str, Tensor] = {}
    for name, constant in controller.constants().items():
        if name != "shift_threshold" or "temperature" in controller.constants():
            # In the hard forms it enters by comparison alone.
            constant.requires_grad_(True)
            free[name] = constant

    def leaf(name: str, value: Tensor) -> Tensor:
        free[name] = value.detach().clone().requires_grad_(True)
        return free[name]

    old, reference = made.scenario, made.scenario.reference
    masses = old.schedule["masses"]
    assert isinstance(reference, mt.Sinusoid) and old.start is not None
    scenario = dataclasses.replace(
        old,
        reference=mt.Sinusoid(
            leaf("amplitude", reference.amplitude),
            leaf("frequency", reference.frequency),
            leaf("offset", reference.offset),
        ),
        parameters=mt.ArmParameters(
            old.parameters.masses,
            *(leaf(key, getattr(old.parameters, key)) for key in ("lengths", "viscous", "coulomb")),
        ),
        schedule={"masses": mt.PiecewiseConstant(masses.times, leaf("masses", masses.values))},
        start=PlantState(*(leaf(f"start {k}", v) for k, v in old.start._asdict().items())),
    )
    network = NetworkState(*(leaf(key, value) for key, value in made.weights._asdict().items()))
    return Case(made.loop, scenario, network), free
