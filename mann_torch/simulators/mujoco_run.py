"""A deployed controller in a MuJoCo model."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from torch import Tensor

from ..checks import POSITIVE, flag, instance, number, wrong
from ..deployment import Ports, Stepper
from ..errors import ConfigError, ShapeError
from ..functional import Numbers, as_float64
from ..signals import Reference
from ..simulation.step_grid import MERGE
from ..types import Measurement
from .mjcf import Payload
from .mujoco_model import MujocoModel, check_payloads
from .policies import start_of


@dataclass(frozen=True)
class MujocoRun:
    """What came of it, a row a tick, and the motion at the end beside."""

    t: Tensor  # (K + 1,) [s]
    q: Tensor  # (K + 1, n) [rad or m]
    qd: Tensor  # (K + 1, n)
    error: Tensor  # (K + 1, p) reference less output
    u: Tensor  # (K, m) what the controller commands
    flags: Tensor  # (K,) int64, as the controller gives them (`mann_torch.deployment`)
    state: Tensor  # (size,) of the controller at the end: it can go on elsewhere
    stopped_at: float | None  # [s] where MuJoCo found numbers not finite, or huge; None: nowhere

    @property
    def srmse(self) -> Tensor:
        """Root mean square of the error (p,), as `mann_torch.srmse` has it."""
        return self.error.square().mean(dim=0).sqrt()


def run_in_mujoco(
    stepper: Stepper,
    model: Any,
    joints: Sequence[str],
    reference: Reference,
    horizon: float,
    *,
    actuators: Sequence[str] | None = None,
    payloads: Sequence[Payload] = (),
    start: tuple[Numbers, Numbers] | None = None,
    weights: Any = None,
    state: Tensor | None = None,
    adapt: bool = True,
) -> MujocoRun:
    """Run a deployed controller, of its own period, for a `horizon` [s].

    At a tick it gets the reference and positions and velocities of the joints, in the order of
    their names, and its input is held until the next. `model` and `actuators` are as `MujocoModel`
    takes them; the model given is left as it is. `payloads` change bodies from the first timestep
    that begins at their time or later. `start` is (q, qd), (n,) each, at t = 0. The controller
    starts from `state`, one of its own from elsewhere, or from the initial one, of initial adaptive
    `weights` if they are given; without `adapt` it does not learn.

    Raises `ConfigError` for a name that is not in the model, a period that is no whole multiple of
    the model's timestep, a horizon below the period, a controller of what is not joints,
    `ShapeError` where the numbers of joints, reference and inputs do not go together, `KindError`.
    """
    instance("stepper", stepper, Stepper)
    world = MujocoModel(model, joints, actuators)
    n, horizon = len(world.positions), number("horizon", horizon, POSITIVE)
    instance("reference", reference, Reference)
    outputs = _check_ports(stepper.ports, n, world.n_inputs, reference)
    steps = _steps(stepper.period, world.timestep)
    period, count = steps * world.timestep, round(horizon / (steps * world.timestep))
    if count < 1:
        raise ConfigError(f"horizon = {horizon} s: is below the period, {period} s")
    waiting = check_payloads(world, payloads)
    begin, adapt = start_of(stepper, weights, state), flag("adapt", adapt)
    world.begin(*_start(start, n))
    times = torch.arange(count + 1, dtype=torch.float64) * period
    motions, inputs, flags, stopped = [], [], [], None
    now: Tensor | None = None
    with torch.no_grad():
        samples = reference(times)
        wanted = torch.cat(samples.upto(stepper.ports.order), dim=-1).to(stepper.dtype)
        for k, t in enumerate(times.tolist()):
            motions.append(torch.from_numpy(np.concatenate(world.motion())))
            if k == count or stopped is not None:
                break
            seen = motions[-1].to(stepper.dtype)
            now = begin(wanted[k], seen) if now is None else now
            u, now, told = stepper.step(now, wanted[k], seen, adapt)
            inputs.append(u.double())
            flags.append(told)
            if not _held(world, inputs[-1].numpy(), t, steps, waiting):
                stopped = float(times[k + 1])
    motion = torch.stack(motions)
    q, qd = motion.split(n, dim=-1)
    return MujocoRun(
        t=times[: len(q)],
        q=q,
        qd=qd,
        error=samples.value[: len(q)] - motion[:, outputs],
        u=torch.stack(inputs),
        flags=torch.tensor(flags),
        state=instance("state", now, Tensor),
        stopped_at=stopped,
    )


def _check_ports(ports: Ports, n: int, n_inputs: int, reference: Reference) -> list[int]:
    """Places of the outputs in what is measured. Raises `ConfigError`, `ShapeError`."""
    if not issubclass(ports.measured, Measurement) or ports.output is None:
        names = ", ".join(channel.name for channel in ports.measurement)
        raise ConfigError(f"the controller measures {names}: not positions and rates of joints")
    if ports.widths != (n, n):
        raise ShapeError(f"joints: {n} of them, the controller measures {ports.widths[0]}")
    if len(ports.input) != n_inputs:
        raise ShapeError(
            f"the controller gives {len(ports.input)} inputs, the model takes {n_inputs}: name as "
            "many actuators"
        )
    if reference.width != ports.width or reference.batch_shape != ():
        raise ShapeError(
            f"reference has {reference.width} numbers and batch shape "
            f"{tuple(reference.batch_shape)}: {ports.width} and none are wanted"
        )
    if reference.order < ports.order:
        raise ConfigError(
            f"the controller asks for {ports.order} derivatives of its reference, "
            f"{type(reference).__name__} has {reference.order}"
        )
    return list(ports.output)


def _steps(period: float, timestep: float) -> int:
    """Timesteps a period. Raises `ConfigError`."""
    steps = round(period / timestep)
    if steps < 1 or abs(steps * timestep - period) > 1e-9 * period:
        raise ConfigError(
            f"period = {period} s: must be a whole multiple of the model's timestep, {timestep} s"
        )
    return steps


def _held(world: MujocoModel, u: Any, t: float, steps: int, waiting: list[Payload]) -> bool:
    """Push for a period from t on, in as many pieces as payloads cut it into."""
    done = 0
    while done < steps:
        now = t + done * world.timestep
        while waiting and waiting[0].t <= now + MERGE:
            world.load(waiting.pop(0))
        piece = steps - done
        if waiting and waiting[0].t < now + piece * world.timestep - MERGE:
            piece = 1
        if not world.push(u, piece):
            return False
        done += piece
    return True


def _start(start: Any, n: int) -> tuple[Any, Any]:
    """q and qd as arrays, or None each. Raises `ShapeError`, `KindError`."""
    if start is None:
        return None, None
    if not isinstance(start, tuple) or len(start) != 2:
        raise wrong("start", start, "(q, qd)")
    rows = [as_float64(row, "start").detach() for row in start]
    if any(row.shape != (n,) for row in rows):
        shapes = ", ".join(str(tuple(row.shape)) for row in rows)
        raise ShapeError(f"start has shapes {shapes}: give ({n},) for q and qd")
    return rows[0].numpy(), rows[1].numpy()
