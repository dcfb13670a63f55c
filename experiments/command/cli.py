"""Command lines: everything is checked before Hydra makes a folder; errors are one line."""

from __future__ import annotations

import dataclasses
import itertools
import os
import re
import shlex
import sys
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import hydra
from hydra import compose, initialize_config_dir
from hydra.core.global_hydra import GlobalHydra
from hydra.core.hydra_config import HydraConfig
from hydra.core.override_parser.overrides_parser import OverridesParser
from hydra.errors import HydraException
from omegaconf import OmegaConf
from omegaconf.errors import OmegaConfBaseException

from mann_torch.errors import ConfigError, MannError

from ..sweeps.jobs import part_of_sweep
from ..sweeps.launchers import check_launcher
from ..sweeps.report import end_of_sweep
from .conf_files import CONF
from .hydra_setup import register, swept

register()

#: Exit codes: a setting that cannot be used, a run that failed, Ctrl-C.
BAD_INPUT, FAILED, INTERRUPTED = 2, 1, 130

_PASS_THROUGH = ("--help", "-h", "--hydra-help", "--version", "--info", "-i", "--shell-completion")
_TAKES_VALUE = ("--config-name", "-cn", "--config-path", "-cp", "--config-dir", "-cd", "--package")


def run_cli(config_name: str, check: Callable[[Any], object], task: Callable[[Any], None]) -> None:
    """Check every job of the command line, then let Hydra run `task` on each."""
    command = shlex.join(["python", "-m", f"experiments.{config_name}", *sys.argv[1:]])
    configurations: list[Any] = []
    swept.clear()
    arguments = _quote_numeric_names(sys.argv[1:])
    sys.argv[1:] = arguments
    entry = hydra.main(version_base="1.3", config_path=str(CONF), config_name=config_name)
    if not any(a.split("=")[0] in _PASS_THROUGH for a in arguments):
        try:
            check_launcher(arguments)
            jobs = list(_jobs(arguments))
            for overrides in jobs:
                cfg = compose_job(config_name, overrides)
                check(cfg)
                configurations.append(cfg)
                _check_run_dir(cfg)
            _check_sweep(arguments, jobs)
        except Exception as error:  # whatever a setting breaks, it is one line and no folder
            fail(error, BAD_INPUT)
    try:
        try:
            entry(_guarded(task))()
        finally:  # after Ctrl-C too
            began = _is_multirun(arguments) and swept and swept[0].is_dir()
            failed = end_of_sweep(swept[0], configurations, command) if began else 0
        if failed:
            fail(MannError(f"{failed} of {len(configurations)} jobs failed"), FAILED)
    except KeyboardInterrupt:
        fail(MannError("interrupted; what was finished has been written"), INTERRUPTED)


def fail(error: Exception, code: int) -> None:
    """One line on stderr, then exit."""
    print(f"error: {_one_line(error)}", file=sys.stderr)
    sys.exit(code)


def compose_job(config_name: str, overrides: list[str]) -> Any:
    """One composed configuration. Raises `ConfigError` in one line where it does not compose."""
    state = GlobalHydra.instance()
    outer = state.hydra  # set inside a task that Hydra runs: compose needs it out of the way
    state.hydra = None
    try:
        with initialize_config_dir(version_base="1.3", config_dir=str(CONF)):
            return compose(config_name, overrides=overrides)
    except Exception as error:  # Hydra raises bare TypeErrors and the like for odd overrides
        raise ConfigError(_one_line(error)) from None
    finally:
        GlobalHydra.instance().hydra = outer


def command_line(module: str) -> str:
    """The command that made the running job, to be written beside its results."""
    overrides = HydraConfig.get().overrides.task
    plain = [re.sub(r"^(\w+)='([^']*)'$", r"\1=\2", override) for override in overrides]
    return shlex.join(["python", "-m", module, *plain])


def _guarded(task: Callable[[Any], None]) -> Callable[[Any], None]:
    def guarded(cfg: Any) -> None:
        try:
            with part_of_sweep(_one_line):
                _refuse_finished_run(Path(HydraConfig.get().runtime.output_dir))
                task(cfg)
        except ConfigError as error:
            fail(error, BAD_INPUT)
        except MannError as error:
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
        raise ConfigError(_one_line(error)) from None
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
    if not _is_multirun(arguments):
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


def _is_multirun(arguments: list[str]) -> bool:
    return any(a in ("-m", "--multirun") for a in arguments)


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
