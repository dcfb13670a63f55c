"""Objects made from open settings: a name in a registry, and arguments of what it names."""

from __future__ import annotations

import difflib
import inspect
from collections.abc import Callable, Iterable, Mapping
from typing import Any

from mann_torch.errors import ConfigError, KindError
from mann_torch.registry import Registry

from ..settings.checks import holds_truth

#: No size in a configuration is larger: it is a slip of the pen, found before anything is there.
MOST = 1000
#: Keys of a node that are no arguments.
LABELS = ("name", "kind")


def mapping(where: str, node: Any) -> dict[str, Any]:
    """An open node as what it holds; nothing for None. Raises `ConfigError`."""
    if node is None:
        return {}
    if not isinstance(node, Mapping):
        raise ConfigError(f"{where} = {node}: give settings by name, as in {where}={{name: ...}}")
    return {str(key): value for key, value in node.items()}


def arguments(
    where: str, node: Mapping[str, Any], labels: Iterable[str] = LABELS
) -> dict[str, Any]:
    """What a node gives beside its labels, None left out. Raises `ConfigError`, `KindError`."""
    given = {k: v for k, v in node.items() if k not in labels and v is not None}
    for name, value in given.items():
        if isinstance(value, list) and holds_truth(value):
            raise KindError(f"{where}.{name} = {value}: give numbers, and a truth value is none")
    return given


def unknown(where: str, name: str, owner: str, known: Iterable[str]) -> ConfigError:
    """What to say of a setting that `owner` does not have."""
    known = list(known)
    near = difflib.get_close_matches(name, known, n=1, cutoff=0.7)
    told = f"choose from {', '.join(known)}" if known else "it has none"
    hint = f"did you mean {where}.{near[0]}? " if near else ""
    return ConfigError(f"unknown setting '{where}.{name}'; {hint}{owner}: {told}")


def kind_of(where: str, registry: Registry[Any], node: Mapping[str, Any]) -> tuple[str, Any]:
    """Name and class that a node names. Raises `ConfigError`."""
    name = node.get("name")
    if name is None:
        raise ConfigError(f"{where} has no name; choose {where}={', '.join(registry)}")
    if not isinstance(name, str):
        raise KindError(f"{where}.name = {name}: give a name")
    return name, registry[name]


def made(where: str, kind: Any, given: Mapping[str, Any], supplied: Mapping[str, Any]) -> Any:
    """An instance: `given` by the user, and of `supplied` what its constructor asks for.

    Where a class has other constructors, class methods that give one, the first that takes all
    that is given does. Raises `ConfigError`, in which a setting has its dotted name.
    """
    makers = [kind, *_others(kind)] if isinstance(kind, type) else [kind]
    every = [_parameters(maker) for maker in makers]
    best = next((n for n, of in enumerate(every) if _takes(of, given, supplied)), None)
    if best is None:
        best = next((n for n, of in enumerate(every) if set(given) <= set(of)), 0)
    maker, takes = makers[best], every[best]
    for name in given:
        if name not in takes:
            known = [n for n in dict.fromkeys(n for of in every for n in of) if n not in supplied]
            raise unknown(where, name, _title(kind), known)
    passed = {name: value for name, value in supplied.items() if name in takes} | dict(given)
    missing = [n for n, p in takes.items() if p.default is p.empty and n not in passed]
    if missing:
        raise ConfigError(f"{where}.{missing[0]} is missing: {_title(kind)} asks for it")
    for name, value in given.items():
        size = takes[name].annotation in ("int", int) and name != "seed"
        if size and isinstance(value, int) and abs(value) > MOST:
            raise ConfigError(f"{where}.{name} = {value}: at most {MOST}")
    return named(where, passed, lambda: maker(**passed))


def named(where: str, names: Iterable[str], make: Callable[[], Any]) -> Any:
    """What `make` makes; a setting that an error begins with gets its dotted name."""
    try:
        return make()
    except ConfigError as error:
        text = str(error)
        begins = any(text.startswith(name) for name in names)
        raise type(error)(f"{where}.{text}" if begins else f"{where}: {text}") from None
    except (TypeError, ValueError, RuntimeError, OverflowError) as error:
        first = str(error).splitlines()[0] if str(error) else ""
        raise ConfigError(f"{where}: {type(error).__name__}: {first}") from None


def _parameters(maker: Any) -> dict[str, inspect.Parameter]:
    kinds = (inspect.Parameter.POSITIONAL_OR_KEYWORD, inspect.Parameter.KEYWORD_ONLY)
    found = inspect.signature(maker).parameters
    return {name: p for name, p in found.items() if p.kind in kinds}


def _others(kind: type) -> list[Any]:
    """Class methods that give an instance."""
    methods = inspect.getmembers(kind, inspect.ismethod)
    own = ("Self", *(base.__name__ for base in kind.__mro__))
    return [
        method
        for name, method in methods
        if not name.startswith("_") and inspect.signature(method).return_annotation in own
    ]


def every_argument(kind: Any) -> set[str]:
    """Names that its constructors take."""
    return {name for maker in [kind, *_others(kind)] for name in _parameters(maker)}


def _takes(
    of: Mapping[str, inspect.Parameter], given: Mapping[str, Any], supplied: Mapping[str, Any]
) -> bool:
    needed = {name for name, p in of.items() if p.default is p.empty}
    return set(given) <= set(of) and needed <= {*given, *supplied}


def _title(kind: Any) -> str:
    return str(getattr(kind, "__name__", kind))
