"""The life of a run: its folder is claimed, worked in, and finished by its last file.

A folder belongs to the settings in its `config.yaml`, and to the process that holds `.lock`. The
run is finished when `metrics.json` is there: it is written last. The same command on the same
folder goes on where it was stopped; another one is refused.
"""

from __future__ import annotations

import os
import re
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO, Any

from omegaconf import OmegaConf
from omegaconf.errors import OmegaConfBaseException
from yaml import YAMLError  # type: ignore[import-untyped]

from mann_torch.errors import ConfigError

from .writing import write_json, write_text

SETTINGS, LOCK, MARK = "config.yaml", ".lock", "metrics.json"
#: Where a run works and what shows meanwhile: no part of what it computes.
ELSEWHERE = ("run_dir", "resume", "workers")
_TEMPORARY = re.compile(r"\..+\.[0-9a-f]{8}")


def is_finished(folder: Path) -> bool:
    """Whether the run that the folder holds came to its end."""
    return (folder / MARK).exists()


def finish(folder: Path, record: dict[str, Any]) -> None:
    """The completion mark: everything else is on disk."""
    write_json(folder / MARK, record)


def check_folder(folder: Path, cfg: Any) -> None:
    """Raise `ConfigError` if a run of these settings could not begin or go on there."""
    _check_settings(folder, cfg)
    if (folder / LOCK).exists():
        with _locked(folder):
            pass


@contextmanager
def claimed(folder: Path, cfg: Any) -> Iterator[bool]:
    """Hold the folder; whether its run is finished. What a killed run left half is removed.

    Raises `ConfigError` where another process holds it, or it holds a run of other settings.
    """
    folder.mkdir(parents=True, exist_ok=True)
    with _locked(folder):
        _check_settings(folder, cfg)
        if is_finished(folder):
            yield True
            return
        for path in folder.rglob("*"):
            of_tensorboard = path.name.startswith("events.out.tfevents")
            if path.is_file() and (of_tensorboard or _TEMPORARY.fullmatch(path.name)):
                path.unlink(missing_ok=True)
        write_text(folder / SETTINGS, OmegaConf.to_yaml(cfg, resolve=True))
        yield False


def run_in(folder: Path, cfg: Any, task: Callable[[Any], None]) -> None:
    """The task, unless the folder already holds all that it would write.

    A run that `resume` names goes on with the settings it was started with.
    """
    resumed = OmegaConf.select(cfg, "resume") is not None
    with claimed(folder, OmegaConf.load(folder / SETTINGS) if resumed else cfg) as finished:
        if finished:
            print(f"finished already, skipped: {folder}", flush=True)
        else:
            task(cfg)


@contextmanager
def _locked(folder: Path) -> Iterator[None]:
    """The system lets go of the lock when its process ends, however that comes about."""
    with open(folder / LOCK, "a+") as file:
        if not _lock(file):
            file.seek(0)
            owner = file.read().strip() or "?"
            raise ConfigError(f"run_dir = {folder}: process {owner} is at work there")
        file.seek(0)
        file.truncate()
        file.write(str(os.getpid()))
        file.flush()
        yield


def _lock(file: IO[str]) -> bool:
    if sys.platform == "win32":
        import msvcrt

        file.seek(0)
        try:
            msvcrt.locking(file.fileno(), msvcrt.LK_NBLCK, 1)
        except OSError:
            return False
        return True
    import fcntl

    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    return True


def _check_settings(folder: Path, cfg: Any) -> None:
    path = folder / SETTINGS
    if not path.exists():
        if is_finished(folder):
            raise ConfigError(f"run_dir = {folder}: already holds a run; name another folder")
        return
    try:
        there = OmegaConf.to_container(OmegaConf.load(path), resolve=True)
    except (OmegaConfBaseException, YAMLError, ValueError) as error:
        raise ConfigError(f"run_dir = {folder}: {path}: {str(error).splitlines()[0]}") from None
    here = OmegaConf.to_container(OmegaConf.create(OmegaConf.to_yaml(cfg, resolve=True)))
    differs = next(_differences(_comparable(there), _comparable(here)), None)
    if differs is not None:
        name, old, new = differs
        raise ConfigError(
            f"run_dir = {folder}: already holds a run of other settings ({name} = {old} there, "
            f"{new} here); name another folder"
        )


def _comparable(tree: Any) -> Any:
    if not isinstance(tree, dict):
        return tree
    return {key: value for key, value in tree.items() if key not in ELSEWHERE}


def _differences(there: Any, here: Any, name: str = "") -> Iterator[tuple[str, Any, Any]]:
    if isinstance(there, dict) and isinstance(here, dict):
        for key in sorted({*there, *here}, key=str):
            inner = f"{name}.{key}" if name else str(key)
            yield from _differences(there.get(key), here.get(key), inner)
    elif there != here and not (there != there and here != here):  # NaN is as good as NaN
        yield name, there, here
