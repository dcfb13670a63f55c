"""Which plants can be drawn, and how; what an animation may be."""

from __future__ import annotations

import shutil
from collections.abc import Mapping
from typing import Any

from mann_torch.errors import ConfigError
from mann_torch.plants import (
    PLANTS,
    CartPole,
    DoubleIntegrator,
    FlexibleJointArm,
    NLinkArm,
    Pendulum,
    PlanarQuadrotor,
    Plant,
    SlotineLiArm,
    TwoLinkArm,
)

from ..settings.config import FilmedConfig
from .arms import Arm, UnitArm
from .cart_pole import CartAndPole
from .drawing import Drawing
from .masses import Masses
from .pendulum import HangingArm
from .quadrotor import Quadrotor

#: By the plant's class; one's own that is made of such a class is drawn like it.
DRAWINGS: dict[type[Plant], type[Drawing]] = {
    TwoLinkArm: Arm,
    NLinkArm: Arm,
    FlexibleJointArm: Arm,
    SlotineLiArm: UnitArm,
    Pendulum: HangingArm,
    CartPole: CartAndPole,
    PlanarQuadrotor: Quadrotor,
    DoubleIntegrator: Masses,
}
GIF, MP4 = "gif", "mp4"
_ASKED: dict[Any, str | None] = {True: GIF, False: None, GIF: GIF, MP4: MP4}


def kind_of_film(output: FilmedConfig) -> str | None:
    """The kind of file that `output.animation` asks for, None for none. Raises `ConfigError`."""
    asked = output.animation
    if not isinstance(asked, bool | str) or asked not in _ASKED:
        raise ConfigError(f"output.animation = {asked}: choose from true (a GIF), false, gif, mp4")
    return _ASKED[asked]


def check_animation(output: FilmedConfig, plants: Mapping[str, Plant]) -> None:
    """Raise `ConfigError` for an animation that can't be made of any of the plants, by name."""
    kind = kind_of_film(output)
    if kind is None:
        return
    if not any(map(drawing_of, plants.values())):
        drawn = [each for each in PLANTS if PLANTS[each] in DRAWINGS]
        raise ConfigError(
            f"output.animation = {output.animation}: no drawing of {', '.join(plants)}; there are "
            f"those of {', '.join(drawn)}"
        )
    if kind == MP4 and shutil.which("ffmpeg") is None:
        raise ConfigError(
            "output.animation = mp4: needs the program ffmpeg, which is not there; gif needs none"
        )


def drawing_of(plant: Plant) -> type[Drawing] | None:
    """How a plant is drawn; None where it has no drawing."""
    return next((DRAWINGS[kind] for kind in type(plant).__mro__ if kind in DRAWINGS), None)
