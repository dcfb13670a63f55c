"""Command lines: everything is checked before Hydra makes a folder; errors are one line."""

from __future__ import annotations

import dataclasses
import functools
import os
import shlex
import signal
import sys
import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import hydra
from hydra import compose, initialize_config_dir
from hydra._internal.utils import get_args_parser
from hydra.core.global_hydra import GlobalHydra
from hydra.core.hydra_config import HydraConfig
from omegaconf import OmegaConf

from mann_torch.errors import ConfigError, MannError

from ..runs.life import check_folder, run_in
from ..sweeps.jobs import part_of_sweep
from ..sweeps.launchers import check_launcher
from . import early
from .conf_files import CONF, SEARCH_KEY, search_path
from .failing import BAD_INPUT, FAILED, INTERRUPTED, fail, one_line, speak_any_terminal
from .hydra_setup import register, swept
from .overrides import (
    as_typed,
    is_multirun,
    job_name,
    jobs_of,
    mistaken_value,
    opened,
    quote_numeric_names,
    unknown_key,
)
from .started import as_started
from .unused import Typed, WhatRuns

register()


def run_cli(
    config_name: str,
    check: Callable[[Any], object],
    task: Callable[[Any], None],
    loops: tuple[Sequence[str], WhatRuns] | None = None,
) -> None:
    """Check every job of the command line, then let Hydra run `task` on each.

    `loops`: nodes whose settings are refused where nothing uses them, and what they lead to.
    """
    if early.asks(sys.argv[1:]):
        early.answer(config_name)
    speak_any_terminal()
    command = shlex.join([*as_started(config_name), *sys.argv[1:]])
    configurations: list[Any] = []
    swept.clear()
    debugged = os.environ.get("HYDRA_FULL_ERROR") == "1"
    try:
        arguments = sys.argv[1:] = opened(quote_numeric_names(sys.argv[1:]))
        _check_options(arguments)
        check_launcher(arguments)
        jobs = list(jobs_of(arguments))
        folders = set()
        for number, overrides in enumerate(jobs):
            try:
                cfg = compose_job(config_name, overrides)
                check(cfg)
                configurations.append(cfg)
                folders.add(cfg.run_dir)
                _check_run_dir(cfg, number if is_multirun(arguments) else None)
            except Exception as error:
                if len(jobs) == 1:
                    raise
                raise ConfigError(f"{job_name(number, jobs)}: {one_line(error)}") from None
        if len(folders) > 1:
            raise ConfigError("run_dir: a sweep has one; its jobs go into numbered folders")
        if loops is not None:
            judged, what_runs = loops
            compose_own = functools.partial(compose_job, config_name)
            Typed(jobs, configurations, compose_own, what_runs).check_used(judged)
    except Exception as error:  # whatever a setting breaks, it is one line and no folder
        fail(error, BAD_INPUT)
    entry = hydra.main(version_base="1.3", config_path=str(CONF), config_name=config_name)
    os.environ["HYDRA_FULL_ERROR"] = "1"  # what fails comes here, and Hydra prints nothing
    try:
        if signal.getsignal(signal.SIGINT) is not signal.SIG_IGN:  # until now it ended at once
            signal.signal(signal.SIGINT, signal.default_int_handler)
        try:
            entry(_guarded(task, debugged))()
        finally:  # after Ctrl-C too
            began = is_multirun(arguments) and swept and swept[0].is_dir()
            failed = _end_of_sweep(configurations, command) if began else 0
        if failed:
            fail(MannError(f"{failed} of {len(configurations)} jobs failed"), FAILED)
    except KeyboardInterrupt:
        signal.signal(signal.SIGINT, signal.SIG_IGN)  # a second one: we are on our way
        fail(MannError("interrupted; what was finished has been written"), INTERRUPTED)
    except Exception as error:
        if debugged:
            raise
        fail(error, FAILED)
    finally:
        if not debugged:
            del os.environ["HYDRA_FULL_ERROR"]


def _end_of_sweep(configurations: list[Any], command: str) -> int:
    from ..sweeps.report import end_of_sweep  # scipy and more, where there was a sweep

    return end_of_sweep(swept[0], configurations, command)


def compose_job(config_name: str, overrides: list[str]) -> Any:
    """One composed configuration. Raises `ConfigError` in one line where it does not compose.

    It looks for groups where the command line does, see `search_path`.
    """
    try:
        return _composed(config_name, overrides)
    except Exception as error:  # Hydra raises bare TypeErrors and the like for odd overrides
        text = one_line(error)
    if text.startswith("Could not"):
        text = unknown_key(text, _composed(config_name, [])) or text
    raise ConfigError(mistaken_value(text) or text)


def _composed(config_name: str, overrides: list[str]) -> Any:
    overrides, places = opened(overrides), search_path()
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


def command_line(name: str) -> str:
    """The command that made the running job, to be written beside its results."""
    overrides = HydraConfig.get().overrides.task
    return shlex.join([*as_started(name), *map(as_typed, overrides)])


def _guarded(task: Callable[[Any], None], debugged: bool) -> Callable[[Any], None]:
    def guarded(cfg: Any) -> None:
        early.settle()
        try:
            run = HydraConfig.get()
            with part_of_sweep(one_line, " ".join(map(as_typed, run.overrides.task))):
                run_in(Path(run.runtime.output_dir), cfg, task)
        except ConfigError as error:
            fail(error, BAD_INPUT)
        except MannError as error:
            fail(error, FAILED)
        except Exception as error:  # Hydra would print what it knows of the job
            if debugged:
                raise
            fail(error, FAILED)

    return guarded


def reject_unknown(cfg: Any, schema: type, where: str = "") -> None:
    """Raise `ConfigError` for a key the schema does not have (`+key=` gets past Hydra)."""
    known = {field.name for field in dataclasses.fields(schema)}
    for key in cfg:
        if str(key) not in known:
            raise ConfigError(f"unknown setting '{where}{key}'; choose from {', '.join(known)}")
        kind = OmegaConf.get_type(cfg, str(key))
        if kind is not None and dataclasses.is_dataclass(kind):
            reject_unknown(cfg[key], kind, f"{where}{key}.")


def _check_run_dir(cfg: Any, number: int | None) -> None:
    """Of one job, or of job `number` of a sweep. Raises `ConfigError`."""
    folder = Path("logs" if cfg.run_dir is None else cfg.run_dir)
    name = "the folder of results" if cfg.run_dir is None else "run_dir"
    existing = next(path for path in (folder, *folder.absolute().parents) if path.exists())
    if not existing.is_dir() or not os.access(existing, os.W_OK):
        raise ConfigError(f"{name} = {folder}: {existing} is not a folder one can write to")
    try:  # root may do what a file system does not allow
        os.rmdir(tempfile.mkdtemp(dir=existing))
    except OSError as error:
        raise ConfigError(f"{name} = {folder}: {error.strerror}") from None
    if cfg.run_dir is not None:
        check_folder(folder if number is None else folder / str(number), cfg)


def _check_options(arguments: list[str]) -> None:
    """Raise `ConfigError` for an option that Hydra does not have; it would print its usage."""
    known = get_args_parser()._option_string_actions
    for argument in arguments:
        name = argument.partition("=")[0]
        if name.startswith("-") and name not in known:
            raise ConfigError(f"unknown option '{name}'; see --help")
