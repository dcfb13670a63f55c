"""Names that a configuration may use: the library's own, and those of installed packages."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, MutableMapping
from importlib.metadata import EntryPoint, entry_points
from typing import Any, Generic, TypeVar, cast

from .errors import ConfigError, KindError

Kind = TypeVar("Kind")


class Registry(MutableMapping[str, type[Kind]], Generic[Kind]):
    """Classes of one interface by name.

    A package of one's own adds to them by an entry point of the group `mann_torch.plants` or the
    like; it is found when its name is first looked for, and loaded then. Raises `ConfigError` for
    an unknown name, an entry point that can't be loaded, that names no such class, or takes a name
    that another has.
    """

    def __init__(
        self, what: str, interface: type, own: Mapping[str, type[Kind]], several: str | None = None
    ) -> None:
        self.what, self.group = what, f"mann_torch.{several or what.removesuffix('s') + 's'}"
        self._interface, self._own = interface, dict(own)
        self._found: dict[str, EntryPoint] | None = None

    def _foreign(self) -> dict[str, EntryPoint]:
        if self._found is None:
            found: dict[str, EntryPoint] = {}
            for point in entry_points(group=self.group):
                same = found.get(point.name)
                if point.name in self._own or (same is not None and same.value != point.value):
                    owner = "the library" if same is None else same.value
                    raise ConfigError(
                        f"entry point {self.group}: {self.what} '{point.name}' of {point.value} "
                        f"has a name that {owner} has; give it another"
                    )
                found[point.name] = point
            self._found = found
        return self._found

    def __getitem__(self, name: str) -> type[Kind]:
        if name in self._own:
            return self._own[name]
        point = self._foreign().get(name)
        if point is None:
            raise ConfigError(f"unknown {self.what} '{name}'; choose from {', '.join(self)}")
        where = f"entry point {self.group}: {self.what} '{name}'"
        try:
            kind: Any = point.load()
        except Exception as error:  # whatever a package of somebody else's does
            told = str(error).strip().splitlines()
            raise ConfigError(
                f"{where} can't be loaded from {point.value} ({type(error).__name__}"
                + (f": {told[0]})" if told else ")")
            ) from None
        if not isinstance(kind, type) or not issubclass(kind, self._interface):
            raise KindError(f"{where}: {point.value} is no {self._interface.__name__}")
        del self._foreign()[name]
        self._own[name] = cast(type[Kind], kind)
        return self._own[name]

    def get(self, name: str, default: Any = None) -> Any:
        """As of any mapping: the default for a name that is unknown."""
        if name not in self:
            return default
        return self[name]

    def __contains__(self, name: object) -> bool:
        return name in self._own or name in self._foreign()

    def __setitem__(self, name: str, kind: type[Kind]) -> None:
        self._own[name] = kind

    def __delitem__(self, name: str) -> None:
        del self._own[name]

    def __iter__(self) -> Iterator[str]:
        return iter([*self._own, *self._foreign()])

    def __len__(self) -> int:
        return len(self._own) + len(self._foreign())
