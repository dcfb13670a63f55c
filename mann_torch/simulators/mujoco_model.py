"""A MuJoCo model by the names of its joints, motors and bodies."""

from __future__ import annotations

import copy
from collections.abc import Sequence
from os import PathLike
from typing import Any

import numpy as np

from ..checks import several, shown, wrong
from ..errors import ConfigError
from .extras import extra
from .mjcf import Payload


class MujocoModel:
    """A copy of a model, whose joints are read and moved in a given order.

    `model` is MuJoCo's `MjModel`, a file's path, or the text of one. Motors are `actuators` by
    name, whose controls are what is put in; where none are given, forces act on the joints
    themselves (`qfrc_applied`). Raises `ConfigError` for a model that MuJoCo does not read, an
    unknown name, a name twice, or a joint that is neither a hinge nor a slide; `KindError`.
    """

    def __init__(
        self, model: Any, joints: Sequence[str], actuators: Sequence[str] | None = None
    ) -> None:
        mujoco = self._mujoco = extra("mujoco")
        self.model = _loaded(mujoco, model)
        # MuJoCo would begin anew at t = 0.
        self.model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_AUTORESET
        self.data = mujoco.MjData(self.model)
        bad = ("QPOS", "QVEL", "QACC", "CTRL")
        self._bad = [int(getattr(mujoco.mjtWarning, f"mjWARN_BAD{x}")) for x in bad]
        kinds = int(mujoco.mjtJoint.mjJNT_HINGE), int(mujoco.mjtJoint.mjJNT_SLIDE)
        numbers = [self.number_of("joint", name) for name in _names("joints", joints)]
        for name, i in zip(joints, numbers, strict=True):
            if int(self.model.jnt_type[i]) not in kinds:
                raise ConfigError(f"joint '{name}' is neither a hinge nor a slide")
        self.positions = self.model.jnt_qposadr[numbers]
        self.velocities = self.model.jnt_dofadr[numbers]
        self.motors: list[int] | None = None
        if actuators is not None:
            named = _names("actuators", actuators)
            self.motors = [self.number_of("actuator", name) for name in named]

    @property
    def timestep(self) -> float:
        """[s]"""
        return float(self.model.opt.timestep)

    @property
    def n_inputs(self) -> int:
        """How many numbers `push` takes."""
        return len(self.positions if self.motors is None else self.motors)

    def begin(self, q: Any = None, qd: Any = None) -> None:
        """Begin at t = 0 with the joints at q and qd (n,), as the model has them if not given."""
        self._mujoco.mj_resetData(self.model, self.data)
        if q is not None:
            self.data.qpos[self.positions] = q
        if qd is not None:
            self.data.qvel[self.velocities] = qd

    def motion(self) -> tuple[Any, Any]:
        """q and qd (n,) now."""
        return self.data.qpos[self.positions].copy(), self.data.qvel[self.velocities].copy()

    def push(self, u: Any, steps: int) -> bool:
        """Hold inputs for some timesteps: whether all stayed finite, and below MuJoCo's 1e10."""
        if self.motors is None:
            self.data.qfrc_applied[self.velocities] = u
        else:
            self.data.ctrl[self.motors] = u
        self._mujoco.mj_step(self.model, self.data, steps)
        finite = np.isfinite(self.data.qpos).all() and np.isfinite(self.data.qvel).all()
        return bool(finite) and not any(self.data.warning[i].number for i in self._bad)

    def load(self, payload: Payload) -> None:
        """Give a body another mass and inertia. Raises `ConfigError` for an unknown body."""
        i = self.number_of("body", payload.body)
        before = self.model.body_mass[i]
        if payload.inertia is None:
            self.model.body_inertia[i] *= payload.mass / before
        else:
            self.model.body_inertia[i] = payload.inertia
        self.model.body_mass[i] = payload.mass
        # What follows from masses; it puts the data it is given at the model's own position.
        self._mujoco.mj_setConst(self.model, self._mujoco.MjData(self.model))

    def number_of(self, kind: str, name: str) -> int:
        """Of a joint, actuator or body. Raises `ConfigError`."""
        code = getattr(self._mujoco.mjtObj, f"mjOBJ_{kind.upper()}")
        found: int = self._mujoco.mj_name2id(self.model, code, name)
        if found < 0:
            count = {"joint": self.model.njnt, "actuator": self.model.nu, "body": self.model.nbody}
            every = (self._mujoco.mj_id2name(self.model, code, i) for i in range(count[kind]))
            known = ", ".join(each for each in every if each and each != "world") or "none"
            raise ConfigError(f"no {kind} '{name}' in the model; it has {known}")
        return found


def check_payloads(model: MujocoModel, payloads: Sequence[Payload]) -> list[Payload]:
    """In the order of their times. Raises `ConfigError`, `KindError`."""
    rows = several("payloads", payloads, Payload)
    for row in rows:
        model.number_of("body", row.body)
        numbers = [row.t, row.mass, *(row.inertia or ())]
        if not all(np.isfinite(numbers)) or row.t < 0 or min(numbers[1:]) <= 0:
            raise ConfigError(f"payload {tuple(row)}: its time must be >= 0, its numbers > 0")
    return sorted(rows, key=lambda row: row.t)


def _names(what: str, given: Sequence[str]) -> list[str]:
    names = several(what, given, str, "a name")
    if not names:
        raise ConfigError(f"{what}: give at least one name")
    if len(set(names)) < len(names):
        raise ConfigError(f"{what} = {names}: a name is there twice")
    return names


def _loaded(mujoco: Any, model: Any) -> Any:
    """A model of one's own: what is changed in it later is nobody else's."""
    if isinstance(model, mujoco.MjModel):
        return copy.copy(model)
    if not isinstance(model, str | PathLike):
        raise wrong("model", model, "an MjModel, a file's path or its text")
    read = mujoco.MjModel.from_xml_path
    if isinstance(model, str) and model.lstrip().startswith("<"):
        read = mujoco.MjModel.from_xml_string
    try:
        return read(str(model))
    except ValueError as error:
        said = " ".join(str(error).split())
        raise ConfigError(f"model = {shown(model)}: MuJoCo says: {said}") from None
