"""A deployed controller in a MuJoCo model."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import torch
from torch import Tensor

from ..checks import POSITIVE, instance, number, wrong
from ..errors import ConfigError, ShapeError
from ..functional import Numbers, as_float64
from ..signals import Reference
from ..simulation.step_grid import MERGE
from ..types import Measurement
from .mjcf import Payload
from .mujoco_model import MujocoModel, check_payloads


class Stepped(Protocol):
    """A deployed controller (`mann_torch.deploy`)."""

    period: float

    def initial_state(self, reference: Any, measurement: Any) -> Any:
        """Before the first tick."""

    def step(self, state: Any, reference: Any, measurement: Any) -> tuple[Tensor, Any, int]:
        """The input (m,), the state after the tick, and flags."""


@dataclass(frozen=True)
class MujocoRun:
    """What came of it, a row a tick, and the motion at the end beside."""

    t: Tensor  # (K + 1,) [s]
    q: Tensor  # (K + 1, n) [rad or m]
    qd: Tensor  # (K + 1, n)
    error: Tensor  # (K + 1, p) reference less q of the first p joints
    u: Tensor  # (K, m) what the controller commands
    flags: Tensor  # (K,) int64, as the controller gives them
    stopped_at: float | None  # [s] where MuJoCo's numbers ceased to be finite; None: nowhere

    @property
    def srmse(self) -> Tensor:
        """Root mean square of the error (p,), as `mann_torch.srmse` has it."""
        return self.error.square().mean(dim=0).sqrt()


def run_in_mujoco(
    stepper: Stepped,
    model: Any,
    joints: Sequence[str],
    reference: Reference,
    horizon: float,
    *,
    actuators: Sequence[str] | None = None,
    payloads: Sequence[Payload] = (),
    start: tuple[Numbers, Numbers] | None = None,
) -> MujocoRun:
    """Run a controller of its own `period` [s] for a `horizon` [s].

    At a tick it gets the reference and a `Measurement` of the joints, in the order of their names,
    and its input is held until the next. A reference of p < n numbers is that of the first p.
    `model` and `actuators` are as `MujocoModel` takes them;
    the model given is left as it is. `payloads` change bodies from the first timestep that begins
    at their time or later. `start` is (q, qd), (n,) each, at t = 0.

    Raises `ConfigError` for a name that is not in the model, a period that is no whole multiple of
    the model's timestep, a horizon below the period, `ShapeError` where the numbers of joints,
    reference and inputs do not go together, `KindError`.
    """
    if not (hasattr(stepper, "initial_state") and callable(getattr(stepper, "step", None))):
        raise wrong("stepper", stepper, "a deployed controller")
    world = MujocoModel(model, joints, actuators)
    n, horizon = len(world.positions), number("horizon", horizon, POSITIVE)
    p = instance("reference", reference, Reference).width
    if p > n or reference.batch_shape != ():
        raise ShapeError(
            f"reference has {p} numbers and batch shape {tuple(reference.batch_shape)}: at most "
            f"one for each of {n} joints, and no batch"
        )
    steps = _steps(number("period", stepper.period, POSITIVE), world.timestep)
    period, count = steps * world.timestep, round(horizon / (steps * world.timestep))
    if count < 1:
        raise ConfigError(f"horizon = {horizon} s: is below the period, {period} s")
    waiting = check_payloads(world, payloads)
    world.begin(*_start(start, n))
    times = torch.arange(count + 1, dtype=torch.float64) * period
    motions, inputs, flags = [], [], []
    state, stopped = None, None
    with torch.no_grad():
        samples = reference(times)
        parts = [part for part in samples.parts if part is not None]
        for k, t in enumerate(times.tolist()):
            motion = Measurement(*map(torch.from_numpy, world.motion()))
            motions.append(motion)
            if k == count or stopped is not None:
                break
            sample = type(samples)(*(part[k] for part in parts))
            if state is None:
                state = stepper.initial_state(sample, motion)
            u, state, flag = stepper.step(state, sample, motion)
            if u.shape != (world.n_inputs,):
                raise ShapeError(
                    f"the controller gives inputs {tuple(u.shape)}: the model takes "
                    f"({world.n_inputs},)"
                )
            inputs.append(u.detach().double())
            flags.append(int(flag))
            if not _held(world, u.detach().double().numpy(), t, steps, waiting):
                stopped = float(times[k + 1])
    rows = len(motions)
    q, qd = (torch.stack(column) for column in zip(*motions, strict=True))
    return MujocoRun(
        t=times[:rows],
        q=q,
        qd=qd,
        error=samples.value[:rows] - q[:, :p],
        u=torch.stack(inputs),
        flags=torch.tensor(flags),
        stopped_at=stopped,
    )


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
