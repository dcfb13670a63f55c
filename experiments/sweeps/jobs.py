"""One job of a sweep: its threads, and what is left of it when it fails."""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import torch
from hydra.core.hydra_config import HydraConfig
from hydra.types import RunMode

from ..runs.workers import at_most
from ..runs.writing import write_json
from .launchers import job_threads

FAILURE = "failed.json"


@contextmanager
def part_of_sweep(one_line: Callable[[Exception], str], name: str) -> Iterator[None]:
    """In a sweep, a job that fails leaves `failed.json` and a line, and the others go on.

    `name`: its overrides. Outside a sweep nothing is done.
    """
    cfg = HydraConfig.get()
    if cfg.mode != RunMode.MULTIRUN:
        yield
        return
    threads = job_threads(cfg.runtime.choices["hydra/launcher"], cfg.launcher)
    if threads is not None:
        torch.set_num_threads(threads)
        os.environ["OMP_NUM_THREADS"] = str(threads)  # of processes that the job starts
    folder = Path(cfg.runtime.output_dir)
    (folder / FAILURE).unlink(missing_ok=True)
    try:
        with at_most(threads):
            yield
    except SystemExit as stop:  # it has said why
        if stop.code:
            write_json(folder / FAILURE, {"error": f"exit code {stop.code}"})
    except Exception as error:
        text = one_line(error)
        write_json(folder / FAILURE, {"error": text})
        print(f"error: job {cfg.job.num} ({name}): {text}", file=sys.stderr, flush=True)


def failure_of(folder: Path) -> str | None:
    """Why the job of this folder failed; None if it did not."""
    try:
        return str(json.loads((folder / FAILURE).read_text())["error"])
    except (OSError, ValueError, KeyError, TypeError):
        return None
