"""Simulators that other people have, as an extra: `pip install mann_torch[simulators]`."""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from .episodes import Moment
    from .mjcf import Payload, arm_mjcf, arm_payloads
    from .mujoco_model import MujocoModel
    from .mujoco_run import MujocoRun, run_in_mujoco
    from .plant_env import PlantEnv
    from .plant_vector_env import PlantVectorEnv
    from .policies import Policy, Run, as_policy, run_episode

#: Where each name is; what it needs is imported when it is first used.
_PLACES = {
    "Moment": "episodes",
    "MujocoModel": "mujoco_model",
    "MujocoRun": "mujoco_run",
    "Payload": "mjcf",
    "PlantEnv": "plant_env",
    "PlantVectorEnv": "plant_vector_env",
    "Policy": "policies",
    "Run": "policies",
    "arm_mjcf": "mjcf",
    "arm_payloads": "mjcf",
    "as_policy": "policies",
    "run_episode": "policies",
    "run_in_mujoco": "mujoco_run",
}

__all__ = [
    "Moment",
    "MujocoModel",
    "MujocoRun",
    "Payload",
    "PlantEnv",
    "PlantVectorEnv",
    "Policy",
    "Run",
    "arm_mjcf",
    "arm_payloads",
    "as_policy",
    "run_episode",
    "run_in_mujoco",
]


def __getattr__(name: str) -> Any:
    if name not in _PLACES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = globals()[name] = getattr(import_module(f".{_PLACES[name]}", __name__), name)
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
