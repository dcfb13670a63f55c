"""Hydra's launchers by name: whether they are installed, and the threads a job has under each."""

from __future__ import annotations

import importlib.util
import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from omegaconf import OmegaConf

from mann_torch.errors import ConfigError

#: How many threads a job may use, from the launcher's settings and the machine's cores.
Threads = Callable[[Any, int], int]


@dataclass(frozen=True)
class Launcher:
    """The plugin that has it, the extra that installs the plugin, and a job's share of cores."""

    plugin: str
    extra: str
    threads: Threads


def cores() -> int:
    """Those this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def _of_joblib(settings: Any, n_cores: int) -> int:
    wanted = int(settings.n_jobs)
    at_once = wanted if wanted > 0 else n_cores + 1 + wanted
    return max(1, n_cores // max(1, at_once))


def _of_queue(settings: Any, n_cores: int) -> int:
    """What the queue grants a job; submitit's local one starts all jobs at once."""
    return int(settings.get("cpus_per_task") or 1)


def _of_ray(settings: Any, n_cores: int) -> int:
    return int(OmegaConf.select(settings, "ray.remote.num_cpus") or 1)


LAUNCHERS = {
    "joblib": Launcher("hydra_plugins.hydra_joblib_launcher", "joblib", _of_joblib),
    "submitit_local": Launcher("hydra_plugins.hydra_submitit_launcher", "submitit", _of_queue),
    "submitit_slurm": Launcher("hydra_plugins.hydra_submitit_launcher", "submitit", _of_queue),
    "ray": Launcher("hydra_plugins.hydra_ray_launcher", "ray", _of_ray),
}


def is_installed(name: str) -> bool:
    """Whether Hydra can use this launcher here."""
    try:
        return importlib.util.find_spec(LAUNCHERS[name].plugin) is not None
    except ModuleNotFoundError:
        return False


def check_launcher(arguments: Sequence[str]) -> None:
    """Raise `ConfigError` if a command line asks for a launcher that is not there."""
    for argument in arguments:
        group, _, name = argument.partition("=")
        if group != "hydra/launcher" or name == "basic":
            continue
        if name not in LAUNCHERS:
            names = ", ".join(["basic", *LAUNCHERS])
            raise ConfigError(f"unknown hydra/launcher '{name}'; choose from {names}")
        if not is_installed(name):
            extra = LAUNCHERS[name].extra
            raise ConfigError(
                f"hydra/launcher={name} is not installed: pip install 'mann_torch[{extra}]'"
            )


def job_threads(name: str, settings: Any) -> int | None:
    """Threads of one job; None where jobs run one after the other, with the whole machine."""
    if name not in LAUNCHERS:
        return None
    return min(LAUNCHERS[name].threads(settings, cores()), cores())
