"""The library's planar arms as MuJoCo models, made from a plant's parameters."""

from __future__ import annotations

from typing import Any, NamedTuple

import torch

from ..checks import POSITIVE, choice, instance, number
from ..errors import ConfigError, ShapeError
from ..plants import NLinkArm, NLinkParameters, TwoLinkArm
from ..plants.plant import Plant
from ..simulation import Scenario
from ..trees import leaves

INTEGRATORS = ("Euler", "RK4", "implicit", "implicitfast")
#: MuJoCo wants inertias above 0; a point mass has this [kg m^2].
LEAST = 1e-12


class Payload(NamedTuple):
    """From a time on, what a body of a MuJoCo model weighs."""

    t: float  # [s]
    body: str
    mass: float  # [kg]
    #: Principal moments (3,) [kg m^2] about the body's centre of mass; None: its own, in the same
    #: proportion to its mass as before.
    inertia: tuple[float, float, float] | None = None


def arm_mjcf(
    plant: Plant,
    parameters: Any = None,
    timestep: float = 1e-3,
    integrator: str = "implicitfast",
) -> str:
    """A `TwoLinkArm` or `NLinkArm` in MuJoCo's format: hinges about -y, gravity along -z.

    Joints `joint_1` ..., links (bodies) `link_1` ..., motors `torque_1` ... [N m]. Mass matrix and
    bias forces are the plant's; viscous friction is the joints' damping, and Coulomb friction
    MuJoCo's own `frictionloss`, which holds at rest where the plant's tanh creeps. `parameters` are
    the plant's defaults if not given; `timestep` [s]. Raises `ConfigError` for another plant or
    integrator, `ShapeError` for parameters with batch dimensions, `DomainError`, `KindError`.
    """
    rows = _links(plant, parameters)
    number("timestep", timestep, POSITIVE)
    choice("integrator", integrator, INTEGRATORS)
    text, reach, motors = "", 0.0, ""
    for i, link in enumerate(zip(*(row.tolist() for row in rows), strict=True), 1):
        mass, length, center, inertia, viscous, coulomb = link
        # Moments about x and z do no work; MuJoCo wants all three to satisfy A + B >= C.
        moment = max(inertia, LEAST)
        text += (
            f'\n<body name="link_{i}" pos="{reach!r} 0 0">'
            f'<joint name="joint_{i}" type="hinge" axis="0 -1 0" damping="{viscous!r}" '
            f'frictionloss="{coulomb!r}"/>'
            f'<inertial pos="{center * length!r} 0 0" mass="{mass!r}" '
            f'diaginertia="{moment!r} {moment!r} {moment!r}"/>'
            f'<geom type="capsule" fromto="0 0 0 {length!r} 0 0" size="{0.03 * length!r}" '
            'contype="0" conaffinity="0"/>'
        )
        motors += f'<motor name="torque_{i}" joint="joint_{i}"/>'
        reach = length
    gravity = float(plant.gravity)  # type: ignore[arg-type]
    return (
        f'<mujoco model="{type(plant).__name__}"><compiler angle="radian"/>'
        f'<option gravity="0 0 {-gravity!r}" timestep="{timestep!r}" integrator="{integrator}"/>'
        f"<worldbody>{text}{'</body>' * len(rows.masses)}</worldbody>\n"
        f"<actuator>{motors}</actuator></mujoco>"
    )


def arm_payloads(plant: Plant, scenario: Scenario) -> list[Payload]:
    """What a scenario's schedule makes of the links of `arm_mjcf`, from time to time.

    Raises `ConfigError` for a schedule of anything but masses and inertias, and as `arm_mjcf`.
    """
    instance("scenario", scenario, Scenario)
    for name in scenario.schedule:
        if name not in ("masses", "inertias"):
            raise ConfigError(f"schedule of '{name}': only masses and inertias change in MuJoCo")
    found = []
    for t in scenario.knots():
        here = scenario.parameters_at(torch.tensor(t, dtype=torch.float64))
        links = _links(plant, here)
        rows = zip(links.masses.tolist(), links.inertias.tolist(), strict=True)
        for i, (mass, inertia) in enumerate(rows, 1):
            moment = max(inertia, LEAST)
            found.append(Payload(t, f"link_{i}", mass, (moment, moment, moment)))
    return found


def _links(plant: Plant, parameters: Any) -> NLinkParameters:
    """An arm's parameters (n,) a field, as those of an arm of n links."""
    if not isinstance(plant, TwoLinkArm | NLinkArm):
        kind = type(instance("plant", plant, Plant)).__name__
        raise ConfigError(f"plant = {kind}: a TwoLinkArm or an NLinkArm becomes a MuJoCo model")
    given = plant.parameters_of() if parameters is None else parameters
    plant.check(given)
    if any(leaf.dim() != 1 for leaf in leaves(given)):
        raise ShapeError(
            f"parameters of batch shape {tuple(leaves(given)[0].shape[:-1])}: a model is one arm"
        )
    rows = {name: getattr(given, name).detach() for name in plant.fields}
    if isinstance(plant, TwoLinkArm):  # point masses at the ends
        masses = rows["masses"]
        rows |= {"centers": torch.ones_like(masses), "inertias": torch.zeros_like(masses)}
    return NLinkParameters(**rows)
