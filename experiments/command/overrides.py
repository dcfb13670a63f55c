"""Overrides of a command line: the jobs they make, names that are numbers, slips of the pen."""

from __future__ import annotations

import difflib
import itertools
import re
from collections.abc import Iterator, Sequence

from hydra.core.override_parser.overrides_parser import OverridesParser
from hydra.core.override_parser.types import Override
from hydra.errors import HydraException
from omegaconf import DictConfig, OmegaConf

from mann_torch.errors import ConfigError

from ..settings.config import OPEN
from ..settings.kinds import wrong_kind
from .conf_files import group_folders
from .started import as_started

#: Every job is checked before the first begins.
MOST_JOBS = 2000
_OPEN = "(?:" + "|".join(map(re.escape, OPEN)) + r")\.[\w.]+"
_TAKES_VALUE = ("--config-name", "-cn", "--config-path", "-cp", "--config-dir", "-cd", "--package")


def is_multirun(arguments: Sequence[str]) -> bool:
    """Whether a command line asks for one."""
    return any(a in ("-m", "--multirun") for a in arguments)


def jobs_of(arguments: list[str]) -> Iterator[list[str]]:
    """The override lists of all jobs: one, or the product of a multirun's choices."""
    multirun = is_multirun(arguments)
    texts, skip = [], False
    for argument in arguments:
        if skip or argument.startswith("-"):
            skip = (not skip and argument in _TAKES_VALUE) or argument in ("-c", "--cfg", "-p")
            continue
        texts.append(argument)
    parsed = [_parsed(text) for text in texts]
    choices: list[list[str]] = []
    count = 1
    for override, text in zip(parsed, texts, strict=True):
        if multirun and override.is_sweep_override():
            key = override.get_key_element()
            values = list(itertools.islice(override.sweep_string_iterator(), MOST_JOBS + 1))
            choices.append([f"{key}={value}" for value in values])
        else:
            choices.append([text])
        count *= len(choices[-1])
        if count > MOST_JOBS:
            raise ConfigError(
                f"a sweep of more than {MOST_JOBS} jobs ({text}): make several, and one table of "
                f"them with {' '.join(as_started('collect'))}"
            )
    for job in itertools.product(*choices):
        yield list(job)


def _parsed(text: str) -> Override:
    if re.fullmatch(r"[^=~]*|=.*", text):
        raise ConfigError(f"'{as_typed(text)}' is no setting: give NAME=VALUE, see --help")
    try:
        return OverridesParser.create().parse_overrides([text])[0]
    except HydraException as error:
        told = str(error).strip().splitlines()[0].removeprefix("LexerNoViableAltException: ")
        raise ConfigError(
            f"{as_typed(text)}: not to be read as NAME=VALUE ({told}); quote a value with spaces, "
            "brackets or signs"
        ) from None


def mistaken_value(message: str) -> str | None:
    """What to say of a value of the wrong kind, which Hydra could not merge."""
    found = re.match(r"Error merging override (.*?) \((.*)\)$", message)
    if found is None:
        return None
    name, _, value = as_typed(found.group(1)).lstrip("+~").partition("=")
    return wrong_kind(name, value, found.group(2))


def job_name(number: int, jobs: Sequence[Sequence[str]]) -> str:
    """A multirun's job by its number and what it does not share with all others."""
    own = [as_typed(o) for o in jobs[number] if not all(o in job for job in jobs)]
    return f"job {number} ({' '.join(own)})"


def as_typed(override: str) -> str:
    """An override as it was before `quote_numeric_names` and `opened`."""
    override = re.sub(rf"^\+\+(?={_OPEN}=)", "", override)
    return re.sub(r"^(\w+)='([^']*)'$", r"\1=\2", override)


def opened(arguments: Sequence[str]) -> list[str]:
    """`plant.stiffness=3` as `++plant.stiffness=3`: what there is, the plant's class says.

    And `sensor=null` as `~sensor`, Hydra's way to say that a group is not chosen.
    """
    absent = {f"{group}=null": f"~{group}" for group in OPEN}
    return [
        re.sub(rf"^(?={_OPEN}=)", "++", absent.get(argument, argument)) for argument in arguments
    ]


def quote_numeric_names(arguments: list[str]) -> list[str]:
    """`scenario=1` as `scenario='1'`: Hydra takes a bare number for an int, not for a name.

    And `output.format=png,pdf` as one text, where it is no sweep.
    """
    quoted = []
    for argument in arguments:
        group, equals, value = argument.partition("=")
        listed = group == "output.format" and re.fullmatch(r"\w+(,\w+)+", value)
        if listed and not is_multirun(arguments):
            argument = f"{group}='{value}'"
        if equals and re.fullmatch(r"\w+", group) and group_folders(group):
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


def unknown_key(message: str, known: DictConfig) -> str | None:
    """What to say of a key that Hydra could not override: the nearest there is, or all of them."""
    found = re.match(r"Could not (?:override|delete from config\.) '([^']+)'", message)
    if found is None or found.group(1).startswith("hydra"):
        return None
    key = found.group(1)
    every = _keys(known)
    if key in every:
        return None
    parent, _, own = key.rpartition(".")
    inside = f"{parent}." if parent in every else ""
    beside = [name.removeprefix(inside) for name in every if name.startswith(inside)]
    elsewhere = [name for name in every if name.rpartition(".")[2] == own]
    near = difflib.get_close_matches(own if inside else key, beside, n=1, cutoff=0.7)
    close = elsewhere or [inside + name for name in near]
    if close:
        return f"unknown setting '{key}'; did you mean {' or '.join(close)}?"
    names = ", ".join(name for name in beside if "." not in name)
    return f"unknown setting '{key}'; choose from {names}" + (f" of {parent}" if inside else "")


def _keys(node: object, prefix: str = "") -> list[str]:
    if not isinstance(node, DictConfig) or node._is_none():
        return []
    found = []
    for key in map(str, node):
        found.append(prefix + key)
        if not OmegaConf.is_missing(node, key) and not OmegaConf.is_interpolation(node, key):
            found += _keys(node[key], f"{prefix}{key}.")
    return found
