"""What was exported: numbers in and out, what is kept, files, and what was left behind."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import torch

from mann_torch.deployment import Stepper
from mann_torch.parts import Actuator
from mann_torch.simulation import ClosedLoop, Scenario
from mann_torch.types import Channel

from ..runs.writing import aligned
from ..settings.export_config import ExportConfig
from .runtimes import RUNTIMES

#: The saved state to start from, beside the runtimes' folders.
START = "start.state"


def files_in(folder: Path) -> dict[str, int]:
    """Bytes of every file below a folder, by its path there."""
    return {
        path.relative_to(folder).as_posix(): path.stat().st_size
        for path in sorted(folder.rglob("*"))
        if path.is_file()
    }


def report_of(
    cfg: ExportConfig,
    title: str,
    stepper: Stepper,
    left: Sequence[str],
    files: Mapping[str, Mapping[str, int]],
    command: str,
) -> str:
    """`report.md`."""
    ports, made = stepper.ports, cfg.export
    rows = [["number", "of reference", "unit", "of measurement", "unit", "of input", "unit"]]
    columns = [_named(row) for row in (ports.reference, ports.measurement, ports.input)]
    for place in range(max(map(len, columns))):
        cells = [column[place] if place < len(column) else ("", "") for column in columns]
        rows.append([str(place), *(text for cell in cells for text in cell)])
    parts = [
        f"# {title}",
        f"Made by `{command}`: a step every {stepper.period:g} s, {made.dtype}; a state of "
        f"{stepper.size} numbers. {_start(cfg)}",
        "## What goes in and out",
        aligned(rows),
        "## Files",
    ]
    for name, found in files.items():
        use = RUNTIMES[name].use.format(name=made.name)
        table = [["file", "bytes"], *([f"{name}/{path}", str(n)] for path, n in found.items())]
        parts += [f"### {RUNTIMES[name].title}", aligned(table), use]
    if left:
        parts.append("## Not exported\n\n" + "\n".join(f"- {what}" for what in left))
    return "\n\n".join(parts) + "\n"


def left_behind(loop: ClosedLoop, scenario: Scenario) -> list[str]:
    """What a loop has in the simulator and a machine has of its own."""
    found = []
    if loop.sensor is not None:
        found.append("the sensor: its instants and its delay are the machine's")
    if scenario.noise is not None:
        found.append("measurement noise")
    if loop.actuator is not None and _lags(loop.actuator):
        found.append("the actuator's lag and rate limit; its limits are in the step")
    if scenario.disturbance is not None:
        found.append("the disturbance")
    return found


def _start(cfg: ExportConfig) -> str:
    """What the saved state is."""
    told = (
        "what it has learned at the end of" if cfg.export.learned else "its state at the start of"
    )
    return (
        f"`{START}` is {told} scenario {cfg.scenario.name} in the simulator, before a first step, "
        "for `restore` in C and `Stepper.from_bytes` in Python."
    )


def _lags(actuator: Actuator) -> bool:
    nothing = torch.zeros(actuator.n_inputs, dtype=torch.float64)
    return actuator.initial_state(nothing) is not None


def _named(row: Sequence[Channel]) -> list[tuple[str, str]]:
    return [(channel.name, channel.unit) for channel in row]
