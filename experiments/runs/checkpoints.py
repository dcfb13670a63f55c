"""Checkpoints of tuning runs: written whole or not at all, read without running anything."""

from __future__ import annotations

import io
import pickle
import zipfile
from pathlib import Path
from typing import Any, cast

import torch
from omegaconf import OmegaConf
from omegaconf.errors import OmegaConfBaseException
from yaml import YAMLError  # type: ignore[import-untyped]

from mann_torch.errors import ConfigError

from ..settings.machine import check_file
from ..settings.study_config import TuneConfig
from .writing import write_bytes

FILE = "checkpoint.pt"


def save(folder: Path, state: dict[str, Any]) -> None:
    """Replace the folder's checkpoint."""
    buffer = io.BytesIO()
    torch.save(state, buffer)
    write_bytes(folder / FILE, buffer.getvalue())


def load(folder: Path) -> dict[str, Any] | None:
    """The folder's checkpoint; None where the run was stopped before its first.

    Raises `ConfigError` for a file that is none.
    """
    path = folder / FILE
    if not path.exists():
        return None
    check_file("resume:", path)
    try:
        state = torch.load(path, weights_only=True)
        if {"z", "optimizer", "history"} <= set(state):
            return cast(dict[str, Any], state)
    except (OSError, RuntimeError, EOFError, TypeError, pickle.UnpicklingError, zipfile.BadZipFile):
        pass
    raise ConfigError(f"resume: {path} is not a checkpoint of a tuning run")


def saved_config(folder: Path) -> TuneConfig:
    """The configuration a run was started with. Raises `ConfigError`."""
    path = folder / "config.yaml"
    if not path.is_file():
        raise ConfigError(f"resume: {folder} holds no tuning run (no config.yaml)")
    try:
        merged = OmegaConf.merge(OmegaConf.structured(TuneConfig), OmegaConf.load(path))
        return cast(TuneConfig, OmegaConf.to_object(merged))
    except (OmegaConfBaseException, YAMLError, ValueError) as error:
        raise ConfigError(f"resume: {path}: {str(error).splitlines()[0]}") from None
