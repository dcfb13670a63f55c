"""The physics that a mechanical plant owes: mass, Coriolis force, power and regressor."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, cast

import torch
from torch import Tensor

from ..functional import times_column
from ..plants import MechanicalPlant
from ..types import PlantState
from .forms import called
from .functions import ROUNDING, SAMPLES, apart
from .plant_bench import Bench
from .telling import broken

#: Lines of the contract of `MechanicalPlant`.
FORCES, KEPT, DRIVEN, SENSED, REGRESSOR = (f"{i} of a MechanicalPlant" for i in range(1, 6))
#: Of the largest term: what rounding may do to a sum of powers or to skew-symmetry.
BALANCE = 1e-9


def check_forces(b: Bench) -> None:
    """Raise `InterfaceError` where M, C, N, B or energy have not the shape that n and m ask for."""
    plant = cast(MechanicalPlant, b.plant)
    c, state, n = b.coefficients, b.state, plant.n_joints
    if not isinstance(state, PlantState) or state.q.shape[-1] != n:
        raise broken(
            plant, SENSED, f"rest() is no PlantState of n_joints = {n} coordinates", "q, qd (n,)"
        )
    if plant.sensing is not None and not set(plant.sensing) <= set(range(n)):
        raise broken(
            plant, SENSED, f"sensing = {plant.sensing}", f"name coordinates from 0 to {n - 1}"
        )
    forces: tuple[tuple[str, Callable[[], Tensor], tuple[int, ...]], ...] = (
        ("mass_matrix", lambda: plant.mass_matrix(state.q, c), (n, n)),
        ("coriolis", lambda: plant.coriolis(state.q, state.qd, c), (n, n)),
        ("load", lambda: plant.load(state.q, state.qd, c), (n,)),
        ("energy", lambda: plant.energy(state, c), ()),
    )
    for what, call, shape in forces:
        found = called(plant, FORCES, f"{what} of a batch of states", call)
        if found.shape != (SAMPLES, *shape):
            wanted = ", ".join(["...", *map(str, shape)])
            raise broken(
                plant, FORCES, f"{what} has shape {tuple(found.shape)}", f"give ({wanted})"
            )
    B, m = (
        called(plant, DRIVEN, "input_matrix", lambda: plant.input_matrix(state.q, c)),
        len(plant.inputs),
    )
    sizes = (n, n) if B is None else tuple(B.shape[-2:])
    if sizes != (n, m):
        raise broken(
            plant,
            DRIVEN,
            f"{m} inputs meet an input_matrix {sizes}",
            f"input_matrix must give B(q) (..., {n}, {m}); None is the identity",
        )


def check_physics(b: Bench) -> None:
    """Raise `InterfaceError` where M, C, energy or regressor are not what they must be."""
    plant, c = cast(MechanicalPlant, b.plant), b.coefficients
    M = plant.mass_matrix(b.state.q, c)
    if apart([M], [M.mT]) > ROUNDING:
        raise broken(
            plant, FORCES, "mass_matrix is not symmetric", "M is the kinetic energy's matrix"
        )
    if not bool((torch.linalg.eigvalsh(M) > 0).all()):
        raise broken(
            plant, FORCES, "mass_matrix is not positive definite", "each motion has inertia"
        )
    _check_coriolis(b, plant, c)
    _check_power(b, plant, c)
    _check_regressor(b, plant, c)


def _slope(function: Callable[..., Tensor], at: tuple[Tensor, ...], along: Any) -> Tensor:
    """Derivative of a function along a direction."""
    found: Tensor = torch.func.jvp(function, at, tuple(along))[1]
    return found


def _check_coriolis(b: Bench, plant: MechanicalPlant, c: object) -> None:
    """dM/dt - 2 C is skew-symmetric, and C qd = dM/dt qd - d(qd' M qd / 2)/dq (Lagrange)."""
    q, qd = b.state
    rate = _slope(lambda x: plant.mass_matrix(x, c), (q,), (qd,))
    C = plant.coriolis(q, qd, c)
    scale = max(1.0, float(rate.abs().max()), float(C.abs().max()))
    S = rate - 2.0 * C
    if float((S + S.mT).abs().max()) > BALANCE * scale:
        raise broken(
            plant,
            FORCES,
            "dM/dt - 2 C is not skew-symmetric",
            "take C from Christoffel's symbols of M: laws of control count on it",
        )
    kinetic = lambda x: plant.kinetic_energy(PlantState(x, qd), c).sum()  # noqa: E731
    owed = times_column(rate, qd) - torch.func.grad(kinetic)(q)
    if apart([times_column(C, qd)], [owed]) > BALANCE:
        raise broken(
            plant,
            FORCES,
            "C qd is not what Lagrange's equations make of M",
            "take C from Christoffel's symbols of M; other forces belong to the load",
        )


def _check_power(b: Bench, plant: MechanicalPlant, c: object) -> None:
    """An undisturbed plant's energy grows by no more than the input's work."""
    q, qd = b.state
    input = plant.grouped(b.u)
    rate = plant.derivative(b.t, b.state, input, None, c)
    growth = _slope(lambda q, qd: plant.energy(PlantState(q, qd), c), (q, qd), rate)
    B = plant.input_matrix(q, c)
    force = b.u if B is None else times_column(B, b.u)
    work = (qd * force).sum(-1)
    scale = max(1.0, float(growth.abs().max()), float(work.abs().max()))
    if bool((growth - work > BALANCE * scale).any()):
        raise broken(
            plant,
            KEPT,
            "an undisturbed plant's energy grows faster than its input works (dE/dt > qd' B tau)",
            "load, energy and mass_matrix do not belong together, or friction drives",
        )


def _check_regressor(b: Bench, plant: MechanicalPlant, c: object) -> None:
    """One theta gives M a + C v + N from Y, wherever the plant is."""
    one = b.sample(0).coefficients
    q, qd = b.state
    v, a = qd.flip(0), q.flip(0) + 0.5
    try:
        Y = plant.regressor(q, qd, v, a)
    except NotImplementedError:
        return
    force = times_column(plant.mass_matrix(q, one), a) + plant.load(q, qd, one)
    force = force + times_column(plant.coriolis(q, qd, one), v)
    if Y.shape[:-1] != force.shape:
        raise broken(
            plant, REGRESSOR, f"regressor has shape {tuple(Y.shape)}", "give Y (..., n, k)"
        )
    rows, right = Y.flatten(0, 1), force.flatten()
    theta: Tensor = torch.linalg.lstsq(rows, right.unsqueeze(-1), driver="gelsd").solution
    if apart([(rows @ theta)[:, 0]], [right]) > BALANCE:
        raise broken(
            plant,
            REGRESSOR,
            "no theta gives M(q) a + C(q, qd) v + N(q, qd) as Y theta",
            "regressor must use v in C, a in M, and the order (q, qd, v, a)",
        )
