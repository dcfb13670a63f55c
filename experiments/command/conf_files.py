"""Where the configuration files are, and the names they offer."""

from __future__ import annotations

import importlib.util
import sys
from collections.abc import Iterable, Sequence
from pathlib import Path

from hydra.core.override_parser.overrides_parser import OverridesParser
from hydra.errors import HydraException

from mann_torch.errors import ConfigError

# conf/ in a checkout, mann_torch/conf in an installed wheel: beside this package in both.
CONF = Path(__file__).resolve().parents[2] / "conf"
_DIR_OPTIONS = ("--config-dir", "-cd")
SEARCH_KEY = "hydra.searchpath"


def search_path(arguments: Sequence[str] | None = None) -> list[str]:
    """Where else a command line looks for groups: `--config-dir` and `hydra.searchpath`.

    Of this process's command line if not given; worker processes have that of their parent.
    Raises `ConfigError` for a folder that does not exist.
    """
    arguments = sys.argv[1:] if arguments is None else arguments
    found: list[str] = []
    named: list[str] = []
    for place, argument in enumerate(arguments):
        option, equals, value = argument.partition("=")
        if option in _DIR_OPTIONS:
            found += [value] if equals else list(arguments[place + 1 : place + 2])
        elif option == SEARCH_KEY:
            named += _listed(argument)
    for where in (*found, *named):
        if not any(path.is_dir() for path in _folders([where])):
            raise ConfigError(f"{SEARCH_KEY}: '{where}' is not a folder")
    return [where if "://" in where else f"file://{Path(where).absolute()}" for where in found] + [
        *named
    ]


def _listed(argument: str) -> list[str]:
    try:
        (override,) = OverridesParser.create().parse_overrides([argument])
        value = override.value()
    except HydraException as error:
        raise ConfigError(str(error).strip().splitlines()[0]) from None
    if not isinstance(value, list):
        raise ConfigError(f"{argument}: give a list of folders, {SEARCH_KEY}=[PATH]")
    return [str(where) for where in value]


def _folders(places: Iterable[str]) -> list[Path]:
    """The folders on disk of a search path; `pkg://` names a Python package."""
    folders = []
    for where in places:
        if where.startswith("pkg://"):
            try:
                spec = importlib.util.find_spec(where.removeprefix("pkg://").replace("/", "."))
            except ImportError:
                continue
            folders += [Path(p) for p in (spec.submodule_search_locations or [])] if spec else []
        else:
            folders.append(Path(where.removeprefix("file://")))
    return folders


def group_folders(group: str) -> list[Path]:
    """Every folder that has files of a configuration group."""
    folders = [folder / group for folder in (CONF, *_folders(search_path()))]
    return [folder for folder in folders if folder.is_dir()]


def group_names(group: str) -> list[str]:
    """The names a configuration group offers."""
    return sorted({p.stem for folder in group_folders(group) for p in folder.glob("*.yaml")})
