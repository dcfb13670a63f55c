"""A loop's controller as a step at a fixed rate, written as C code or for another runtime."""

from __future__ import annotations

from .command import early

if __name__ == "__main__":
    early.begin("export")

import time
from pathlib import Path
from typing import Any, cast

from hydra.core.hydra_config import HydraConfig
from omegaconf import OmegaConf

from mann_torch.deployment import Stepper
from mann_torch.errors import ConfigError

from .building.build import Experiment
from .building.what_runs import LOOP_NODES, what_runs
from .command.cli import command_line, reject_unknown, run_cli
from .exporting.composing import experiment_of, first_state, learned_state, stepper_of
from .exporting.report import START, files_in, left_behind, report_of
from .exporting.runtimes import RUNTIMES, check_runtimes, write_runtime
from .runs.life import finish
from .runs.progress import progress_bar
from .runs.writing import write_bytes, write_text
from .settings.checks import check_horizon, check_positive, check_variants
from .settings.config import title_of
from .settings.export_config import CONSTANTS, PRECISIONS, ExportConfig


def main() -> None:
    """Command line of `python -m experiments.export`."""
    run_cli("export", checked, _task, (LOOP_NODES, what_runs))


def checked(cfg: Any) -> tuple[ExportConfig, Experiment, Stepper]:
    """The configuration as plain dataclasses, the loop, and a step that can be written.

    Raises `MannError`.
    """
    reject_unknown(cfg, ExportConfig)
    plain = cast(ExportConfig, OmegaConf.to_object(cfg))
    made = plain.export
    check_horizon(plain.horizon)
    check_variants(made.runtimes, tuple(RUNTIMES), "export.runtime")
    for name, known in (("dtype", PRECISIONS), ("constants", CONSTANTS)):
        if getattr(made, name) not in known:
            raise ConfigError(
                f"export.{name} = {getattr(made, name)}: choose from {', '.join(known)}"
            )
    if made.period is not None:
        check_positive("export.period", made.period)
    experiment = experiment_of(plain)
    stepper = stepper_of(plain, experiment, "torch")  # nothing is compiled to check
    check_runtimes(stepper, made)
    return plain, experiment, stepper


def _task(cfg: Any) -> None:
    plain, experiment, stepper = checked(cfg)
    folder = Path(HydraConfig.get().runtime.output_dir)
    command, start = command_line("export"), time.perf_counter()
    made = learned_state if plain.export.learned else first_state
    write_bytes(folder / START, stepper.to_bytes(made(plain, experiment, stepper)))
    files = {}
    with progress_bar(len(plain.export.runtimes), "runtime") as bar:
        for name in plain.export.runtimes:
            files[name] = files_in(write_runtime(name, stepper, plain.export, folder))
            bar.update()
    title = f"{plain.controller['name']} for {plain.plant['name']}"
    left = left_behind(experiment.loop, experiment.scenario)
    report = report_of(plain, title, stepper, left, files, command)
    write_text(folder / "report.md", report)
    record = {
        "command": command,
        "title": title_of(plain),
        "plant": plain.plant["name"],
        "controller": plain.controller["name"],
        "period": stepper.period,
        "dtype": plain.export.dtype,
        "state_numbers": stepper.size,
        "files": files,
        "wall_s": time.perf_counter() - start,
        "units": {"period": "s", "wall_s": "s"},
    }
    finish(folder, record)
    print(report)
    print(f"written to {folder}", flush=True)


if __name__ == "__main__":
    main()
