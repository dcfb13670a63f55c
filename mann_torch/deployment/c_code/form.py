"""What of a stepper goes into C: its numbers by name and place, and the two programs."""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any, NamedTuple

import torch
from torch import Tensor

from ...checks import choice, flag, instance
from ...compiled import Program, UntraceableError
from ...compiled.c99 import CUnit, c99_function
from ...compiled.real import DOUBLE, REALS, Real
from ...errors import ConfigError, ExportError
from ...trees import leaf_paths, leaves, map_tensors
from ..ports import Ports
from ..programs import start_program, step_program

if TYPE_CHECKING:
    from ..stepper import Stepper

#: How constants are written: in the code, or in a struct that is given at each call.
CONSTANTS = ("baked", "struct")
#: What no identifier may be.
_WORDS = frozenset(
    re.findall(
        r"\w+",
        """auto break case char const continue default do double else enum extern float for goto if
        inline int long register restrict return short signed sizeof static struct switch typedef
        union unsigned void volatile while""",
    )
)


class Field(NamedTuple):
    """A tensor of the state or of the constants: where it lies in its array."""

    path: str  # in Python
    name: str  # in C
    kind: str  # f, i or b
    offset: int
    shape: tuple[int, ...]

    @property
    def size(self) -> int:
        """Numbers in it."""
        return math.prod(self.shape)

    @property
    def array(self) -> str:
        """Array of the state that it lies in."""
        return "f" if self.kind == "f" else "k"


@dataclass(frozen=True)
class Form:
    """A stepper, and how it is to be written."""

    stepper: Stepper
    name: str
    settable: bool
    libm: bool

    @property
    def title(self) -> str:
        """What it is."""
        return f"{self.name}, {type(self.stepper.tick.controller).__name__}"

    @property
    def ports(self) -> Ports:
        """Numbers that go in and out."""
        return self.stepper.ports

    @property
    def real(self) -> Real:
        """The arithmetic of its steps."""
        return REALS[self.stepper.dtype]

    @cached_property
    def state(self) -> tuple[Field, ...]:
        """What is kept from step to step."""
        return _fields(leaf_paths(self._like), leaves(self._like))

    @cached_property
    def constants(self) -> tuple[Field, ...]:
        """Every constant and first value that the controller holds."""
        return _fields(list(self.stepper.values), list(self.stepper.values.values()))

    @cached_property
    def step(self) -> Program:
        """The tick's program."""
        return _traced(lambda: step_program(self.stepper.tick, self._like, self.stepper.dtype)[0])

    @cached_property
    def start(self) -> Program:
        """The start's program, in float64."""
        return _traced(lambda: start_program(self.stepper.tick, _double(self._like))[0])

    @property
    def _like(self) -> Any:
        return self.stepper.blob.like

    @cached_property
    def units(self) -> tuple[CUnit, CUnit]:
        """Texts of start and step; the start's constants have a name of their own in float32."""
        first, own = (None, None) if self.settable else self.baked
        return (
            c99_function(self.start, f"{self.name}_begin", first),
            c99_function(self.step, f"{self.name}_advance", own),
        )

    @property
    def baked(self) -> tuple[str, str]:
        """How names of arrays of constants begin: those that the start reads, and the steps."""
        own = f"{self.name}_baked_"
        return own if self.real is DOUBLE else f"{self.name}_first_", own

    def size(self, array: str) -> int:
        """Numbers of the state in `f` or `k`."""
        return sum(field.size for field in self.state if field.array == array)

    def count(self, array: str) -> int:
        """Constants in `f` or `k`: floating ones, and others."""
        return sum(field.size for field in self.constants if field.array == array)

    @property
    def bytes(self) -> int:
        """Bytes of a saved state."""
        return 24 + (self.size("f") + self.size("k")) * self.real.bytes


def form_of(stepper: Stepper, name: str, constants: str, libm: bool) -> Form:
    """A form, checked. Raises `ConfigError`, `KindError`, `ExportError`."""
    check_name(name)
    if constants not in CONSTANTS:
        raise ConfigError(f"constants = {constants!r}: choose one of {', '.join(CONSTANTS)}")
    instance("name", name, str)
    if not re.fullmatch(r"[a-z][a-z0-9_]{0,40}", name) or name in _WORDS:
        raise ConfigError(
            f"name = {name!r}: must be a C identifier of small letters, digits and _, 41 at most"
        )
    choice("constants", constants, CONSTANTS)
    form = Form(stepper, name, constants == "struct", flag("libm", libm))
    form.units  # noqa: B018  what cannot be written is refused before any file is
    return form


def _double(tree: Any) -> Any:
    return map_tensors(lambda x: x.double() if x.is_floating_point() else x, tree)


def check_name(name: object) -> None:
    """Raise `KindError` or `ConfigError` for what is no name of files and C functions."""
    text = instance("name", name, str)
    if not re.fullmatch(r"[a-z][a-z0-9_]{0,40}", text) or text in _WORDS:
        raise ConfigError(
            f"name = {text!r}: must be a C identifier of small letters, digits and _, 41 at most"
        )


def _traced(make: Any) -> Program:
    try:
        found: Program = make()
    except UntraceableError as error:
        raise ExportError(f"the controller cannot be written in C: {error}") from None
    return found


def _fields(paths: Sequence[str], tensors: Sequence[Tensor]) -> tuple[Field, ...]:
    """Fields one after the other, in two arrays, by the shortest ends of their paths that tell."""
    found, ends = [], {"f": 0, "k": 0}
    for path, name, x in zip(paths, _short(paths), tensors, strict=True):
        kind = "f" if x.is_floating_point() else "b" if x.dtype == torch.bool else "i"
        array = "f" if kind == "f" else "k"
        found.append(Field(path, name, kind, ends[array], tuple(x.shape)))
        ends[array] += x.numel()
    return tuple(found)


def _short(paths: Sequence[str]) -> list[str]:
    """An identifier for each path: as many of its last parts as no other path ends with."""
    parts = [path.split(".") for path in paths]
    ends = Counter(".".join(p[-n:]) for p in parts for n in range(1, len(p) + 1))
    names = []
    for p in parts:
        n = next((n for n in range(1, len(p)) if ends[".".join(p[-n:])] == 1), len(p))
        name = re.sub(r"\W", "_", "_".join(p[-n:]))
        names.append(f"{name}_" if name in _WORDS or not name[0].isalpha() else name)
    return names
