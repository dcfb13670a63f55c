"""Command lines: everything is checked before Hydra makes a folder; errors are one line."""

from __future__ import annotations

import dataclasses
import itertools
import os
import re
import shlex
import signal
import sys
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import hydra
from hydra import compose, initialize_config_dir
from hydra._internal.utils import get_args_parser
from hydra.core.global_hydra import GlobalHydra
from hydra.core.hydra_config import HydraConfig
from hydra.core.override_parser.overrides_parser import OverridesParser
from hydra.errors import HydraException
from omegaconf import OmegaConf

from mann_torch.errors import ConfigError, MannError

from ..runs.life import check_folder, run_in
from .conf_files import CONF
from .failing import fail, one_line, speak_any_terminal
from .hydra_setup import register

register()

#: Exit codes: a setting that cannot be used, a run that failed, Ctrl-C.
BAD_INPUT, FAILED, INTERRUPTED = 2, 1, 130

_PASS_THROUGH = ("--help", "-h", "--hydra-help", "--version", "--info", "-i", "--shell-completion")
_TAKES_VALUE = ("--config-name", "-cn", "--config-path", "-cp", "--config-dir", "-cd", "--package")


def run_cli(config_name: str, check: Callable[[Any], object], task: Callable[[Any], None]) -> None:
    """Check every job of the command line, then let Hydra run `task` on each."""
    speak_any_terminal()
    debugged = os.environ.get("HYDRA_FULL_ERROR") == "1"
    arguments = _quote_numeric_names(sys.argv[1:])
    sys.argv[1:] = arguments
    entry = hydra.main(version_base="1.3", config_path=str(CONF), config_name=config_name)
    if not any(a.split("=")[0] in _PASS_THROUGH for a in arguments):
        try:
            _check_options(arguments)
            jobs = list(_jobs(arguments))
            sweeps = _is_multirun(arguments)
            folders = set()
            for number, overrides in enumerate(jobs):
                cfg = compose_job(config_name, overrides)
                check(cfg)
                folders.add(cfg.run_dir)
                _check_run_dir(cfg, number if sweeps else None)
            if len(folders) > 1:
                raise ConfigError("run_dir: a sweep has one; its jobs go into numbered folders")
        except Exception as error:  # whatever a setting breaks, it is one line and no folder
            fail(error, BAD_INPUT)
    os.environ["HYDRA_FULL_ERROR"] = "1"  # what fails comes here, and Hydra prints nothing
    try:
        entry(_guarded(task, debugged))()
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


def compose_job(config_name: str, overrides: list[str]) -> Any:
    """One composed configuration. Raises `ConfigError` in one line where it does not compose."""
    state = GlobalHydra.instance()
    outer = state.hydra  # set inside a task that Hydra runs: compose needs it out of the way
    state.hydra = None
    try:
        with initialize_config_dir(version_base="1.3", config_dir=str(CONF)):
            return compose(config_name, overrides=overrides)
    except Exception as error:  # Hydra raises bare TypeErrors and the like for odd overrides
        raise ConfigError(one_line(error)) from None
    finally:
        GlobalHydra.instance().hydra = outer


def command_line(module: str) -> str:
    """The command that made the running job, to be written beside its results."""
    overrides = HydraConfig.get().overrides.task
    plain = [re.sub(r"^(\w+)='([^']*)'$", r"\1=\2", override) for override in overrides]
    return shlex.join(["python", "-m", module, *plain])


def _guarded(task: Callable[[Any], None], debugged: bool) -> Callable[[Any], None]:
    def guarded(cfg: Any) -> None:
        try:
            run_in(Path(HydraConfig.get().runtime.output_dir), cfg, task)
        except ConfigError as error:
            fail(error, BAD_INPUT)
        except MannError as error:
            fail(error, FAILED)
        except Exception as error:  # Hydra would print what it knows of the job
            if debugged:
                raise
            fail(error, FAILED)

    return guarded


def _jobs(arguments: list[str]) -> Iterator[list[str]]:
    """The override lists of all jobs: one, or the product of a multirun's choices."""
    multirun = _is_multirun(arguments)
    texts, skip = [], False
    for argument in arguments:
        if skip or argument.startswith("-"):
            skip = (not skip and argument in _TAKES_VALUE) or argument in ("-c", "--cfg", "-p")
            continue
        texts.append(argument)
    try:
        parsed = OverridesParser.create().parse_overrides(texts)
    except HydraException as error:
        raise ConfigError(one_line(error)) from None
    choices: list[list[str]] = []
    for override, text in zip(parsed, texts, strict=True):
        if multirun and override.is_sweep_override():
            key = override.get_key_element()
            choices.append([f"{key}={value}" for value in override.sweep_string_iterator()])
        else:
            choices.append([text])
    for job in itertools.product(*choices):
        yield list(job)


def _quote_numeric_names(arguments: list[str]) -> list[str]:
    """`scenario=1` as `scenario='1'`: Hydra takes a bare number for an int, not for a name."""
    quoted = []
    for argument in arguments:
        group, equals, _ = argument.partition("=")
        if equals and (CONF / group).is_dir() and re.fullmatch(r"\w+", group):
            try:
                (override,) = OverridesParser.create().parse_overrides([argument])
                values = list(override.sweep_iterator()) if override.is_sweep_override() else None
                if values is not None:
                    argument = f"{group}=" + ",".join(f"'{value}'" for value in values)
                elif isinstance(override.value(), int | float):
                    argument = f"{group}='{override.value()}'"
            except HydraException:
                pass  # reported with all other bad overrides
        quoted.append(argument)
    return quoted


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


def _is_multirun(arguments: list[str]) -> bool:
    return any(a in ("-m", "--multirun") for a in arguments)
