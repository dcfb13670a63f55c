"""What a run leaves behind: metrics and TensorBoard logs of a trajectory."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias, cast

import numpy as np
from hydra.core.hydra_config import HydraConfig
from omegaconf import OmegaConf

from mann_torch import Trajectory, reallocations, srmse, switches

from ..command.cli import compose_job
from ..command.overrides import as_typed
from ..command.started import arguments_of
from ..runs.memory_figures import attends, is_soft
from ..settings.config import SimulateConfig

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from torch.utils.tensorboard import SummaryWriter

#: Settings of where and how results are written: they tell nothing about a run.
WRITING = ("run_dir", "resume", "output.", "workers")
#: What a run of `simulate` is of.
IDENTITY = ("scenario/name", "controller/name", "keys/name")
Writer: TypeAlias = "SummaryWriter"
#: TensorBoard is for looking: at most this many points a curve. The record is the .npz file.
MAX_POINTS = 2000


def metrics_of(trajectory: Trajectory) -> dict[str, Any]:
    """Figures of merit, one entry a draw; SRMSE, one an output, NaN for a draw that diverged."""
    return {
        "srmse": srmse(trajectory).tolist(),
        "srmse_after_10s": srmse(trajectory, after=10.0).tolist(),
        "reallocations": reallocations(trajectory).tolist(),
        "switches": switches(trajectory).tolist(),
        "status": trajectory.describe_status(),
    }


def channels_of(trajectory: Trajectory) -> dict[str, list[dict[str, str]]]:
    """Names and units of `outputs`, of which SRMSE has one number each, and of `inputs`."""
    found = {"outputs": trajectory.outputs, "inputs": trajectory.inputs}
    return {name: [channel._asdict() for channel in row] for name, row in found.items()}


def units_of(trajectory: Trajectory) -> dict[str, Any]:
    """Of the metrics: one an output where there is one number an output."""
    units = [channel.unit for channel in trajectory.outputs]
    return {"srmse": units, "srmse_after_10s": units, "wall_s": "s"}


def summary_writer(folder: Path, command: str) -> Writer:
    """TensorBoard's writer, in a folder named by what was asked for: TensorBoard lists runs so."""
    from torch.utils.tensorboard import SummaryWriter  # where something is logged

    return SummaryWriter(str(folder / run_name(command)))


def log_run(
    folder: Path,
    cfg: SimulateConfig,
    arrays: Mapping[str, np.ndarray],
    metrics: Mapping[str, Any],
    figures: Mapping[str, Figure],
    command: str,
) -> None:
    """TensorBoard: curves against time in ms, figures, and the settings with their results."""
    with summary_writer(folder, command) as writer:
        stride = -(-len(arrays["t"]) // MAX_POINTS)
        steps = np.round(arrays["t"][::stride] * 1000).astype(int).tolist()
        for tag, values in _curves(arrays):
            for step, value in zip(steps, values[::stride].tolist(), strict=True):
                writer.add_scalar(tag, value, step)
        results = {
            f"metrics/srmse_{name}": float(np.mean([row[place] for row in metrics["srmse"]]))
            for place, name in enumerate(arrays["outputs"][:, 0].tolist())
        }
        log_summary(writer, telling_settings(cfg, IDENTITY), results, figures)


def log_summary(
    writer: Writer,
    settings: Mapping[str, Any],
    results: Mapping[str, float],
    figures: Mapping[str, Figure],
) -> None:
    """Figures, results as scalars, and the settings (flat) with them as hparams."""
    from torch.utils.tensorboard.summary import hparams

    for name, figure in figures.items():
        writer.add_figure(name, figure, close=False)
    # add_hparams would open a second run named by the time of day.
    for summary in hparams(dict(settings), dict(results)):
        writer._get_file_writer().add_summary(summary)
    for tag, value in results.items():
        writer.add_scalar(tag, value)


def _curves(arrays: Mapping[str, np.ndarray]) -> list[tuple[str, np.ndarray]]:
    """Errors by output, inputs by name, and what a memory attends to, of each draw."""
    outputs, inputs = (arrays[name][:, 0].tolist() for name in ("outputs", "inputs"))
    columns = [("error", i, f"error_{name}") for i, name in enumerate(outputs)]
    columns += [("input", i, name) for i, name in enumerate(inputs)]
    if "applied" in arrays:
        columns += [("applied", i, f"{name}_applied") for i, name in enumerate(inputs)]
    acting = arrays["disturbances"][:, 0].tolist()
    columns += [("disturbance", i, name) for i, name in enumerate(acting)]
    curves = []
    for draw in range(arrays["output"].shape[1]):
        curves += [(f"draw{draw}/{tag}", arrays[a][:, draw, i]) for a, i, tag in columns]
        if not attends(arrays):
            continue
        soft = is_soft(arrays["weights"][:, draw])
        if soft:
            for slot in range(arrays["weights"].shape[-1]):
                curve = arrays["weights"][:, draw, slot]
                curves.append((f"draw{draw}/weight_{slot + 1}", curve))
        else:
            for name in ("attended", "reallocations"):
                curves.append((f"draw{draw}/{name}", arrays[name][:, draw]))
    return curves


def _asked_for() -> list[str]:
    """This run's overrides as they were typed, without where and how results are written."""
    if not HydraConfig.initialized():
        return []
    return _telling(map(as_typed, HydraConfig.get().overrides.task))


def _telling(overrides: Iterable[str]) -> list[str]:
    return [o for o in overrides if not o.lstrip("+~").startswith(WRITING)]


def run_name(command: str) -> str:
    """What a command asked for as a folder's name, empty where nothing was."""
    asked = _telling(arguments_of(command))
    return re.sub(r"[^\w=,.+~-]+", "_", ",".join(asked))[:120].strip("_")


def telling_settings(cfg: Any, always: Sequence[str] = ()) -> dict[str, Any]:
    """The settings that differ from the command's own or were named by the user, by flat name."""
    flat = flat_settings(asdict(cfg))
    if not HydraConfig.initialized():
        return flat
    own_cfg = compose_job(str(HydraConfig.get().job.config_name), [])
    usual = flat_settings(cast(dict[str, Any], OmegaConf.to_container(own_cfg, resolve=True)))
    keys = [o.lstrip("+~").partition("=")[0].replace(".", "/") for o in _asked_for()]
    named = {*keys, *(f"{key}/name" for key in keys), *always}
    own = [name for name in flat if name in named or flat[name] != usual.get(name)]
    kept = [name for name in own if not name.replace("/", ".").startswith(WRITING)]
    return {name: flat[name] for name in sorted(kept, key=lambda name: name not in always)}


def flat_settings(tree: Mapping[str, Any], prefix: str = "") -> dict[str, Any]:
    """Nested settings as one level of numbers, texts and truth values."""
    flat: dict[str, Any] = {}
    for key, value in tree.items():
        if isinstance(value, Mapping):
            flat.update(flat_settings(value, f"{prefix}{key}/"))
        elif isinstance(value, bool | int | float | str):
            flat[prefix + key] = value
        else:
            flat[prefix + key] = str(value)
    return flat
