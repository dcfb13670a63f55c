"""Command lines: everything is checked before Hydra makes a folder; errors are one line."""

from __future__ import annotations

import dataclasses
import os
import re
import shlex
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import hydra
from hydra import compose, initialize_config_dir
from hydra.core.global_hydra import GlobalHydra
from hydra.core.hydra_config import HydraConfig
from hydra.errors import HydraException
from hydra.types import RunMode
from omegaconf import OmegaConf
from omegaconf.errors import OmegaConfBaseException

from mann_torch.errors import ConfigError, MannError

from . import early
from .conf_files import CONF, SEARCH_KEY, search_path
from .hydra_setup import register
from .overrides import as_typed, is_multirun, job_name, jobs_of, quote_numeric_names, unknown_key

register()

#: Exit codes: a setting that cannot be used, a run that failed, Ctrl-C.
BAD_INPUT, FAILED, INTERRUPTED = 2, 1, 130


def run_cli(config_name: str, check: Callable[[Any], object], task: Callable[[Any], None]) -> None:
    """Check every job of the command line, then let Hydra run `task` on each."""
    if early.asks(sys.argv[1:]):
        early.answer(config_name)
    try:
        arguments = sys.argv[1:] = quote_numeric_names(sys.argv[1:])
        jobs = list(jobs_of(arguments))
        for number, overrides in enumerate(jobs):
            try:
                cfg = compose_job(config_name, overrides)
                check(cfg)
                _check_run_dir(cfg)
            except Exception as error:
                if len(jobs) == 1:
                    raise
                raise ConfigError(f"{job_name(number, jobs)}: {_one_line(error)}") from None
        _check_sweep(arguments, jobs)
    except Exception as error:  # whatever a setting breaks, it is one line and no folder
        fail(error, BAD_INPUT)
    entry = hydra.main(version_base="1.3", config_path=str(CONF), config_name=config_name)
    try:
        entry(_guarded(task))()
    except KeyboardInterrupt:
        fail(MannError("interrupted; what was finished has been written"), INTERRUPTED)


def fail(error: Exception, code: int) -> None:
    """One line on stderr, then exit."""
    print(f"error: {_one_line(error)}", file=sys.stderr)
    sys.exit(code)


def compose_job(config_name: str, overrides: list[str]) -> Any:
    """One composed configuration. Raises `ConfigError` in one line where it does not compose.

    It looks for groups where the command line does, see `search_path`.
    """
    try:
        return _composed(config_name, overrides)
    except Exception as error:  # Hydra raises bare TypeErrors and the like for odd overrides
        text = _one_line(error)
    if text.startswith("Could not"):
        text = unknown_key(text, _composed(config_name, [])) or text
    raise ConfigError(text)


def _composed(config_name: str, overrides: list[str]) -> Any:
    places = search_path()
    if places:
        quoted = ",".join("'" + place.replace("'", r"\'") + "'" for place in places)
        rest = [o for o in overrides if o.partition("=")[0] != SEARCH_KEY]
        overrides = [*rest, f"{SEARCH_KEY}=[{quoted}]"]
    state = GlobalHydra.instance()
    outer = state.hydra  # set inside a task that Hydra runs: compose needs it out of the way
    state.hydra = None
    try:
        with initialize_config_dir(version_base="1.3", config_dir=str(CONF)):
            return compose(config_name, overrides=overrides)
    finally:
        GlobalHydra.instance().hydra = outer


def command_line(module: str) -> str:
    """The command that made the running job, to be written beside its results."""
    overrides = HydraConfig.get().overrides.task
    return shlex.join(["python", "-m", module, *map(as_typed, overrides)])


def _guarded(task: Callable[[Any], None]) -> Callable[[Any], None]:
    def guarded(cfg: Any) -> None:
        try:
            _refuse_finished_run(Path(HydraConfig.get().runtime.output_dir))
            task(cfg)
        except ConfigError as error:
            fail(_of_job(error), BAD_INPUT)
        except MannError as error:
            fail(_of_job(error), FAILED)

    return guarded


def _of_job(error: MannError) -> MannError:
    """An error of a multirun's job names the job."""
    run = HydraConfig.get()
    if run.mode != RunMode.MULTIRUN:
        return error
    return MannError(f"job {run.job.num} ({' '.join(map(as_typed, run.overrides.task))}): {error}")


def reject_unknown(cfg: Any, schema: type, where: str = "") -> None:
    """Raise `ConfigError` for a key the schema does not have (`+key=` gets past Hydra)."""
    known = {field.name for field in dataclasses.fields(schema)}
    for key in cfg:
        if str(key) not in known:
            raise ConfigError(f"unknown setting '{where}{key}'; choose from {', '.join(known)}")
        kind = OmegaConf.get_type(cfg, str(key))
        if kind is not None and dataclasses.is_dataclass(kind):
            reject_unknown(cfg[key], kind, f"{where}{key}.")


def _check_run_dir(cfg: Any) -> None:
    if cfg.run_dir is None:
        return
    folder = Path(cfg.run_dir)
    existing = next(path for path in (folder, *folder.absolute().parents) if path.exists())
    if not existing.is_dir() or not os.access(existing, os.W_OK):
        raise ConfigError(f"run_dir = {folder}: {existing} is not a folder one can write to")
    try:  # root may do what a file system does not allow
        os.rmdir(tempfile.mkdtemp(dir=existing))
    except OSError as error:
        raise ConfigError(f"run_dir = {folder}: {error.strerror}") from None
    _refuse_finished_run(folder)


def _check_sweep(arguments: list[str], jobs: list[list[str]]) -> None:
    """A sweep writes into numbered folders of one `run_dir`, none of which may hold a run."""
    if not is_multirun(arguments):
        return
    folders = {o.partition("=")[2] for job in jobs for o in job if o.startswith("run_dir=")}
    if len(folders) > 1:
        raise ConfigError("run_dir: a sweep has one; its jobs go into numbered folders there")
    for folder in folders:
        for number in range(len(jobs)):
            _refuse_finished_run(Path(folder) / str(number))


def _refuse_finished_run(folder: Path) -> None:
    if (folder / "metrics.json").exists():
        raise ConfigError(f"run_dir = {folder}: already holds a run; name another folder")


def _one_line(error: Exception) -> str:
    text = str(error).strip()
    missing = re.search(r"Could not find '([^']+)/([^'/]+)'", text)
    if missing:
        options = re.search(
            r"Available options in '[^']+':\s*((?:\S+\s*)+?)(?:Config search|$)", text
        )
        group, name = missing.groups()
        names = ", ".join(options.group(1).split()) if options else "see --help"
        return f"unknown {group} '{name}'; choose from {names}"
    lines = [line.strip() for line in text.splitlines() if line.strip()]
    cause = error.__cause__
    first = lines[0] if lines else ""
    if not isinstance(error, MannError | HydraException | OmegaConfBaseException):
        first = f"{type(error).__name__}: {first}"
    if cause is not None and str(cause).strip():
        first = f"{first} ({str(cause).strip().splitlines()[0]})"
    return first
