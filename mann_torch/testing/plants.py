"""`check_plant`: whether a plant keeps the contract that loops, solvers and pictures build on."""

from __future__ import annotations

from functools import partial
from typing import Any

import torch
from torch import Tensor

from ..checks import instance
from ..plants import MechanicalPlant, Plant
from ..stiff import FirstOrderBlock, SecondOrderBlock, StiffBlock
from ..trees import leaves
from ..types import InputGains
from .mechanical_plants import check_forces, check_physics
from .plant_bench import ROUNDING, SAMPLES, Bench, apart, bench, called
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
    if parameters is None:
        parameters = called(plant, 4, "parameters_of() with the defaults", plant.parameters_of)
    else:
        plant.check(parameters)
    check_rest(plant)
    tried = bench(plant, parameters, states)
    if isinstance(plant, MechanicalPlant):
        check_forces(tried)
    check_forms(tried)
    _check_purity(tried)
    _check_batch(tried)
    _check_transformed(tried)
    check_gradients(tried)
    _check_linearized(tried)
    if isinstance(plant, MechanicalPlant):
        check_physics(tried)


def _check_purity(b: Bench) -> None:
    """Same arguments, same bits; nothing is written to."""
    plant, given = b.plant, [argument.clone() for argument in b.arguments()]
    held = {name: tensor.clone() for name, tensor in _tensors(plant).items()}
    first = [leaf.clone() for leaf in leaves(b.derivative())]
    if not all(map(torch.equal, given, b.arguments())):
        raise broken(plant, 3, "derivative writes into its arguments", "compute new tensors")
    count = len(leaves(b.state))
    b.of([x + 0.1 if i < count else x for i, x in enumerate(given)]).derivative()
    second = leaves(b.derivative())
    for name, tensor in _tensors(plant).items():
        if name not in held or not torch.equal(tensor, held[name]):
            raise broken(
                plant, 3, f"derivative changes {name}", "what changes is state, not module"
            )
    if not all(map(torch.equal, first, second)):
        raise broken(
            plant,
            3,
            "derivative gives other numbers for the same arguments",
            "it must depend on its arguments alone: no random numbers, nothing kept between calls",
        )


def _tensors(plant: Plant) -> dict[str, Tensor]:
    """Parameters and buffers of the module by name."""
    return {**dict(plant.named_parameters()), **dict(plant.named_buffers())}


def _check_batch(b: Bench) -> None:
    """A sample of a batch is what it is alone, and batches may have several dimensions."""
    together = leaves(b.derivative())
    for i in range(SAMPLES):
        alone = leaves(called(b.plant, 3, "derivative of a single state", b.sample(i).derivative))
        row = [leaf[i] for leaf in together]
        if any(a.shape != r.shape for a, r in zip(alone, row, strict=True)):
            raise broken(
                b.plant, 3, "derivative of a single state is no row", "allow no batch at all"
            )
        if apart(alone, row) > ROUNDING:
            raise broken(
                b.plant,
                3,
                f"sample {i} of a batch has another derivative than the same state alone",
                "samples must not mix: work along the last dimensions only",
            )
    folded = b.of([x.unflatten(0, (2, -1)) for x in b.arguments()])
    folded = folded._replace(t=b.t.unflatten(0, (2, -1)))
    grid = leaves(called(b.plant, 3, "derivative of a batch (2, 4)", folded.derivative))
    if apart([x.flatten(0, 1) for x in grid], together) > ROUNDING:
        raise broken(
            b.plant, 3, "a batch (2, 4) has another derivative", "count dimensions from last"
        )


def _check_transformed(b: Bench) -> None:
    """No decision on values in Python: those cannot be traced, nor mapped over."""
    one = b.sample(0)
    c, count = one.coefficients, len(leaves(b.state))

    def rate(t: Tensor, *given: Tensor) -> tuple[Tensor, ...]:
        of = one.of([*given[: count + 1], *leaves(one.parameters), *given[count + 1 :]])
        u = b.plant.grouped(of.u)
        return tuple(leaves(b.plant.derivative(t, of.state, u, of.disturbance, c)))

    wind = [] if b.disturbance is None else [b.disturbance]
    moved = [*leaves(b.state), b.u, *wind]
    mapped = called(
        b.plant,
        3,
        "derivative under torch.func.vmap (decide by torch.where, without .item() or bool())",
        lambda: torch.func.vmap(rate)(b.t, *moved),
    )
    for i in range(SAMPLES):
        alone = rate(b.t[i], *[x[i] for x in moved])
        if apart([leaf[i] for leaf in mapped], alone) > ROUNDING:
            raise broken(b.plant, 3, "derivative differs under torch.func.vmap", "use torch.where")


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
