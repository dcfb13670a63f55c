"""`check_plant`: whether a plant keeps the contract that loops, solvers and pictures build on."""

from __future__ import annotations

from functools import partial
from typing import Any

import torch
from torch import Tensor

from ..checks import instance
from ..plants import MechanicalPlant, Plant
from ..stiff import FirstOrderBlock, SecondOrderBlock, StiffBlock
from ..trees import leaves, rebuilt
from ..types import InputGains
from .forms import called, check_held
from .functions import ROUNDING, SAMPLES, Tried, apart, check_batch, check_mapped, check_pure
from .mechanical_plants import check_forces, check_physics
from .plant_bench import Bench, bench
from .plant_forms import check_forms, check_names, check_rest
from .plant_gradients import check_gradients
from .telling import broken


def check_plant(plant: Plant, parameters: Any = None, states: Any = None) -> None:
    """Raise `InterfaceError` where a plant breaks a line of its contract, which it names.

    `parameters` (rows (d,), the defaults if None) are tried with variations of a hundredth;
    `states`, its fields (8, d), are needed where the plant has no sense at random ones about its
    `rest`. A mechanical plant is held to its physics too: M, C, energy and regressor. Raises as
    `Plant.check` for parameters outside their domains, and `KindError` for what is no plant.
    """
    instance("plant", plant, Plant)
    check_names(plant)
    check_held(plant, 3, "fields")
    if parameters is None:
        parameters = called(plant, 4, "parameters_of() with the defaults", plant.parameters_of)
    else:
        plant.check(parameters)
    check_rest(plant)
    tried = bench(plant, parameters, states)
    if isinstance(plant, MechanicalPlant):
        check_forces(tried)
    check_forms(tried)
    _check_function(tried)
    check_gradients(tried)
    _check_linearized(tried)
    if isinstance(plant, MechanicalPlant):
        check_physics(tried)


def _check_function(b: Bench) -> None:
    """The derivative is a function of its arguments alone, of any batch."""
    count = len(leaves(b.state))

    def rates(plant: Plant, given: list[Tensor]) -> list[Tensor]:
        return leaves(b.of(given[1:])._replace(t=given[0]).derivative())

    tried = Tried(b.plant, 3, "derivative", rates, [b.t, *b.arguments()])
    check_pure(tried)
    check_batch(tried)
    # Held, as in a step: they are computed once, outside it.
    c = b.sample(0).coefficients

    def under(plant: Plant, given: list[Tensor]) -> list[Tensor]:
        t, *rest = given
        state = rebuilt(b.state, rest[:count])
        u, rest = rest[count], rest[count + 1 :]
        wind = rest.pop(0) if b.disturbance is not None else None
        return leaves(plant.derivative(t, state, plant.grouped(u), wind, c))

    wind = [] if b.disturbance is None else [b.disturbance]
    moved = [b.t, *leaves(b.state), b.u, *wind]
    check_mapped(Tried(b.plant, 3, "derivative", under, moved))


def _check_linearized(b: Bench) -> None:
    """The same derivative, and blocks that fit the state."""
    c, u, rate = b.coefficients, b.plant.grouped(b.u), leaves(b.derivative())
    seen = sum(leaf.shape[-1] for leaf in leaves(b.plant.measure(b.state, c)))
    m = b.u.shape[-1]
    ones = torch.ones(SAMPLES, m, seen, dtype=torch.float64)
    gains = InputGains(ones, ones[..., 0])
    for what, given in (("a held input", None), ("gains", gains)):
        call = partial(b.plant.linearized, b.t, b.state, u, b.disturbance, c, given)
        found, block = called(b.plant, 6, f"linearized with {what}", call)
        if apart(leaves(found), rate) > ROUNDING:
            raise broken(
                b.plant,
                6,
                f"linearized with {what} gives another derivative than `derivative`",
                "its first result is the derivative itself; only the block may be approximate",
            )
        if block is not None and not isinstance(block, FirstOrderBlock | SecondOrderBlock):
            raise broken(b.plant, 6, f"linearized with {what} gives no stiff block", "or give None")
        _check_block(b, block, sum(leaf.shape[-1] for leaf in rate))


def _check_block(b: Bench, block: StiffBlock | None, width: int) -> None:
    """Shapes that a solve with the state's rate can use."""
    if block is None:
        return
    wide = width // 2 if isinstance(block, SecondOrderBlock) else width
    for part, value in zip(block._fields, block, strict=True):
        dims = 1 if part == "drift" else 2
        if value.shape[-dims:] != (wide,) * dims or value.dim() > 1 + dims:
            raise broken(
                b.plant,
                6,
                f"{part} of the stiff block has shape {tuple(value.shape)}",
                f"it goes with a state of {width} numbers: (..., {', '.join([str(wide)] * dims)})",
            )
