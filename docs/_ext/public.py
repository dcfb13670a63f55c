"""The public names of the library, each with the one place that documents it."""

from __future__ import annotations

import inspect
import sys
from dataclasses import dataclass
from importlib import import_module
from typing import Any

from sphinx.pycode import ModuleAnalyzer

from mann_torch.registry import Registry

#: Packages and modules of the reference, in its order, and what a page says of each.
PACKAGES = {
    "mann_torch.control": "Controllers, adaptive laws and networks",
    "mann_torch.memory": "The working memory, attention, cells and sequences",
    "mann_torch.plants": "Plants",
    "mann_torch.signals": "References, disturbances, noise and schedules",
    "mann_torch.parts": "Actuators, sensors, clocks and reference models",
    "mann_torch.simulation": "Closed loops, solvers and rollouts",
    "mann_torch.tuning": "Gradients and the tuner",
    "mann_torch.testing": "Contracts of parts of one's own",
    "mann_torch.deployment": "Controllers that leave the simulator",
    "mann_torch.simulators": "Gymnasium and MuJoCo",
    "mann_torch.compiled": "What the compiler says",
    "mann_torch.metrics": "Figures of merit",
    "mann_torch.figures": "Pictures",
    "mann_torch.types": "Values that travel between the layers",
    "mann_torch.constraints": "Constants and their domains",
    "mann_torch.functional": "Functions that a step may use",
    "mann_torch.registry": "Names in configurations",
    "mann_torch.errors": "Errors",
}

#: Of the compiler, what a user meets; the rest is the library's own.
CHOSEN = {"mann_torch.compiled": ("UntraceableError", "check_agreement", "missing")}


@dataclass(frozen=True)
class Public:
    """A name of a package, and the object behind it."""

    package: str
    name: str
    thing: Any

    @property
    def place(self) -> str:
        """The name it is documented by."""
        return f"{self.package}.{self.name}"

    @property
    def kind(self) -> str:
        """class, function or data: of an exception, class."""
        if isinstance(self.thing, type):
            return "class"
        return "function" if inspect.isroutine(self.thing) else "data"

    @property
    def room(self) -> str:
        """The module or the room of the package it lives in, e.g. `laws`."""
        home = getattr(self.thing, "__module__", "") or ""
        inside = home.removeprefix(f"{self.package}.").split(".")
        return inside[0] if home.startswith(f"{self.package}.") and len(inside) > 1 else ""


def names_of(package: str) -> list[str]:
    """What a package exports; of a module without `__all__`, what it defines."""
    if package in CHOSEN:
        return list(CHOSEN[package])
    module = import_module(package)
    if hasattr(module, "__all__"):
        return sorted(module.__all__, key=str.lower)
    commented = {name for _, name in ModuleAnalyzer.for_module(package).find_attr_docs()}
    return [
        name
        for name, thing in vars(module).items()
        if name[0] != "_" and (getattr(thing, "__module__", "") == package or name in commented)
    ]


def everything() -> list[Public]:
    """All public names of all packages, in the reference's order."""
    return [
        Public(package, name, getattr(import_module(package), name))
        for package in PACKAGES
        for name in names_of(package)
    ]


def homes(names: list[Public]) -> dict[int, Public]:
    """By an object's id, where it is documented: in its own package if that exports it."""
    found: dict[int, Public] = {}
    for public in names:
        known = found.get(id(public.thing))
        own = str(getattr(public.thing, "__module__", "")).startswith(public.package)
        if public.kind == "data":
            found.setdefault(id(public.thing), public)
        elif known is None or (own and not str(known.thing.__module__).startswith(known.package)):
            found[id(public.thing)] = public
    return found


def comment_of(package: str, name: str) -> list[str]:
    """The `#:` lines above a constant, wherever in the package it is defined."""
    modules = [package, *sorted(m for m in sys.modules if m.startswith(f"{package}."))]
    for module in modules:
        if getattr(sys.modules[module], name, None) is None:
            continue
        found = ModuleAnalyzer.for_module(module).find_attr_docs().get(("", name))
        if found:
            return list(found)
    return []


def members_of(registry: Registry[Any]) -> list[tuple[str, type]]:
    """The library's own entries of a registry."""
    return [(name, registry[name]) for name in registry]
