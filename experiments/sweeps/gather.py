"""Runs found on disk: their settings, what they measured, how they ended."""

from __future__ import annotations

import json
import os
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from omegaconf import OmegaConf
from omegaconf.errors import OmegaConfBaseException
from yaml import YAMLError  # type: ignore[import-untyped]

from mann_torch.errors import ConfigError

from ..runs.life import ELSEWHERE, MARK, SETTINGS
from .jobs import failure_of
from .measures import Measured, command_of, measured, units_of

#: Not a setting but what it led to: a column where not all runs went by the same engine.
ENGINE = "engine"
_HYDRA = ".hydra"


@dataclass(frozen=True)
class Run:
    """One row: settings by dotted name, and which of them its command line named."""

    name: str
    settings: Mapping[str, Any]
    named: tuple[str, ...]
    status: str
    command: str = ""
    metrics: Measured = field(default_factory=dict)
    folder: Path | None = None
    units: Mapping[str, str] = field(default_factory=dict)  # of metrics that have one

    @property
    def finished(self) -> bool:
        """Whether its metrics are on disk."""
        return bool(self.command)


def read_run(folder: Path, name: str, cfg: Any = None) -> Run:
    """The run of a folder. `cfg`: what it would have been told, if it wrote no settings."""
    tree = _settings(folder / SETTINGS) or _settings(folder / _HYDRA / SETTINGS)
    if tree is None and cfg is not None:
        tree = OmegaConf.to_container(cfg, resolve=True)
    settings = dict(flat(tree or {}))
    named = tuple(_named(folder / _HYDRA / "overrides.yaml"))
    failed = failure_of(folder)
    try:
        record = json.loads((folder / MARK).read_text())
        command = command_of(record)
        metrics, status = measured(record) if command else ({}, "not of these commands")
        units = units_of(record)
        if "engine" in record:
            settings[ENGINE] = record["engine"]
    except FileNotFoundError:
        status = "not finished" if failed is None else f"failed: {failed}"
        return Run(name, settings, named, status, folder=folder)
    except (OSError, ValueError, KeyError, TypeError, AttributeError):
        return Run(name, settings, named, "metrics.json cannot be read")
    status = status if failed is None else f"failed: {failed}"
    return Run(name, settings, named, status, command, metrics, folder, units)


def runs_below(folder: Path, label: str = "") -> list[Run]:
    """Every run in a folder, by name, numbers in order. Raises `ConfigError` if none is finished.

    `label`: what stands before their names.
    """
    if not folder.is_dir():
        raise ConfigError(f"{folder} is not a folder")
    found = []
    for path in _run_folders(folder):
        name = path.relative_to(folder).as_posix()
        found.append(read_run(path, f"{label}{'' if label and name == '.' else name}"))
    if not any(run.finished for run in found):
        raise ConfigError(f"{folder} holds no finished run")
    return found


def same_command(runs: Sequence[Run]) -> str:
    """The command that made them. Raises `ConfigError` if there are several."""
    commands = sorted({run.command for run in runs if run.command})
    if len(commands) > 1:
        raise ConfigError(f"runs of {' and '.join(commands)}: collect those of one command")
    return commands[0] if commands else ""


def differing(runs: Sequence[Run]) -> dict[str, list[Any]]:
    """Settings that are not the same in all runs: a value a run, None where it has none.

    A group counts by its `name`; what follows from the name of a group is left out, unless a
    command line named it. The engine comes last.
    """
    keys = list(dict.fromkeys(key for run in runs for key in run.settings))
    columns = {key: [run.settings.get(key) for run in runs] for key in keys}
    columns = {key: v for key, v in columns.items() if len(_values(key, v)) > 1}
    groups = {key: v for key, v in columns.items() if key.endswith(".name")}
    named = dict.fromkeys(name for run in runs for name in run.named)
    kept = {}
    for key, values in columns.items():
        spelt = any(key == name or key.startswith(f"{name}.") for name in named if "." in name)
        spelt = spelt or key in named
        if (
            key in groups
            or spelt
            or key == ENGINE
            or not any(_follows(values, v) for v in groups.values())
        ):
            kept[key.removesuffix(".name") if key in groups else key] = values
    order = {name: place for place, name in enumerate(named)} | {ENGINE: len(named) + 1}
    return dict(sorted(kept.items(), key=lambda item: order.get(item[0], len(named))))


def flat(tree: Any, prefix: str = "") -> Iterator[tuple[str, Any]]:
    """Nested settings by dotted name; lists are values."""
    for key, value in tree.items():
        if isinstance(value, Mapping) and value:
            yield from flat(value, f"{prefix}{key}.")
        elif prefix or key not in ELSEWHERE:
            yield f"{prefix}{key}", value


def _values(key: str, values: Sequence[Any]) -> set[str]:
    """Those of a column; a run that did not finish went by no engine."""
    return {repr(each) for each in values if key != ENGINE or each is not None}


def _follows(values: Sequence[Any], names: Sequence[Any]) -> bool:
    """Whether each name has one value."""
    pairs = {(repr(name), repr(value)) for name, value in zip(names, values, strict=True)}
    return len(pairs) == len({name for name, _ in pairs})


def _run_folders(folder: Path) -> Iterator[Path]:
    """Folders that hold a run, not those inside one."""
    children = {entry.name: entry for entry in os.scandir(folder)}
    if {MARK, SETTINGS, _HYDRA} & children.keys():
        yield folder
        return
    names = [name for name, entry in children.items() if entry.is_dir() and name[0] != "."]
    for name in sorted(names, key=lambda name: (not name.isdigit(), name.zfill(12), name)):
        yield from _run_folders(folder / name)


def _settings(path: Path) -> Any:
    try:
        tree = OmegaConf.to_container(OmegaConf.load(path), resolve=False)
    except (OSError, OmegaConfBaseException, YAMLError, ValueError):
        return None
    return tree if isinstance(tree, dict) else None


def _named(path: Path) -> Iterator[str]:
    try:
        overrides = OmegaConf.to_container(OmegaConf.load(path))
    except (OSError, OmegaConfBaseException, YAMLError, ValueError):
        return
    for override in overrides if isinstance(overrides, list) else []:
        yield str(override).partition("=")[0].lstrip("+~").partition("@")[0]
