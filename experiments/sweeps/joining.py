"""Ensembles of which each job computed a portion, put together again."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path

from ..ensembles.report import Told, write_ensembles
from ..ensembles.rollouts import joined, read_rollouts
from ..runs.life import MARK
from ..settings.ensemble_config import PORTION
from .gather import ENGINE, Run, differing


def write_joined(folder: Path, runs: Sequence[Run], command: str) -> bool:
    """One page and one histogram of all rollouts; whether there were several runs to join."""
    finished = [run for run in runs if run.command == "ensemble"]
    if len(finished) < 2:
        return False
    write_ensembles(folder, _ensembles(finished), command)
    return True


def _ensembles(runs: Sequence[Run]) -> dict[str, Told]:
    """Runs that differ only in which rollouts they computed are one; named by what else differs."""
    portion = (*PORTION, ENGINE, "output")
    columns = {k: v for k, v in differing(runs).items() if k.partition(".")[0] not in portion}
    groups: dict[str, list[Run]] = {}
    for place, run in enumerate(runs):
        name = ", ".join(f"{key} {values[place]}" for key, values in columns.items())
        groups.setdefault(name, []).append(run)
    return {name: _told(group) for name, group in groups.items()}


def _told(runs: Sequence[Run]) -> Told:
    folders = [run.folder for run in runs if run.folder is not None]
    record = json.loads((folders[0] / MARK).read_text())
    outputs = [(each["name"], each["unit"]) for each in record["outputs"]]
    rollouts = joined([read_rollouts(folder, outputs) for folder in folders])
    draw = int(runs[0].settings["initial.draw"])
    return Told(rollouts, record["title"], record["alone"], draw)
