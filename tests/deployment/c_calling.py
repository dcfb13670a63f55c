"""An exported controller compiled, loaded and called from Python."""

from __future__ import annotations

import ctypes
import shutil
import subprocess
from pathlib import Path

import pytest
import torch
from torch import Tensor

import mann_torch as mt
from mann_torch.deployment import Stepped
from mann_torch.deployment.c_code.form import form_of
from mann_torch.deployment.c_code.makefile import FLAGS
from tests.compiled.c99_building import FMA

NAME = "ctl"


def needs(program: str) -> str:
    """Its path; the test is skipped where there is none."""
    found = shutil.which(program)
    if found is None:
        pytest.skip(f"no {program} here")
    return found


def made(folder: Path, *goals: str, compiler: str = "gcc", flags: str = "-O2") -> str:
    """What `make` says, in an exported folder."""
    command = [needs("make"), "-s", "-C", str(folder), *goals, f"CC={needs(compiler)}"]
    done = subprocess.run([*command, f"CFLAGS={flags}"], capture_output=True, text=True)
    assert done.returncode == 0, done.stdout[-2000:] + done.stderr[-2000:]
    assert not done.stderr
    return done.stdout


class InC:
    """An exported controller with fma, if there is one, as its stepper is called.

    A flat state is what lies in the C state, but for the flags at its end.
    """

    def __init__(self, stepper: mt.Stepper, folder: Path, constants: str = "baked") -> None:
        stepper.to_c(folder, NAME, constants)
        library = folder / f"lib{NAME}_{len(list(folder.iterdir()))}.so"
        command = [needs("gcc"), *FLAGS, "-O2", *FMA, "-shared", "-fPIC", str(folder / f"{NAME}.c")]
        subprocess.run([*command, "-o", str(library), "-lm"], check=True)
        self._c, self.stepper = ctypes.CDLL(str(library)), stepper
        self._bytes = form_of(stepper, NAME, constants, True).bytes
        self.unpacked = stepper.unpacked
        self.constants = self._defaults(constants) if constants == "struct" else None

    def _defaults(self, constants: str) -> Tensor:
        form = form_of(self.stepper, NAME, constants, True)
        count = form.count("f") + form.count("k")
        kind = ctypes.c_char * (count * form.real.bytes)
        defaults = self._c.ctl_default_constants
        defaults.restype = type("Constants", (ctypes.Structure,), {"_fields_": [("x", kind)]})
        return torch.frombuffer(bytearray(bytes(defaults())), dtype=form.real.dtype)

    def _given(self, state: Tensor) -> list[ctypes.c_void_p]:
        constants = [] if self.constants is None else [_at(self.constants)]
        return [_at(state), *constants]

    def initial_state(self, reference: Tensor, measurement: Tensor) -> Tensor:
        state = torch.zeros(self.stepper.size, dtype=self.stepper.dtype)
        self._c.ctl_init(*self._given(state), _at(reference), _at(measurement))
        return state

    def reset(self, state: Tensor, reference: Tensor, measurement: Tensor) -> Tensor:
        state = state.clone()
        self._c.ctl_reset(*self._given(state), _at(reference), _at(measurement))
        return state

    def step(
        self, state: Tensor, reference: Tensor, measurement: Tensor, adapt: bool = True
    ) -> Stepped:
        state = state.clone()
        u = torch.zeros(len(self.stepper.ports.input), dtype=self.stepper.dtype)
        given = [*self._given(state), _at(reference), _at(measurement)]
        flags = self._c.ctl_step(*given, ctypes.c_int(adapt), _at(u))
        return Stepped(u, state, flags)

    def to_bytes(self, state: Tensor) -> bytes:
        room = ctypes.create_string_buffer(self._bytes)
        self._c.ctl_save(_at(state), room)
        return room.raw

    def from_bytes(self, data: bytes) -> Tensor | int:
        """A state, or why it is refused."""
        state = torch.zeros(self.stepper.size, dtype=self.stepper.dtype)
        refused = self._c.ctl_restore(_at(state), ctypes.create_string_buffer(data, len(data)))
        return refused or state


def _at(x: Tensor) -> ctypes.c_void_p:
    assert x.is_contiguous()
    return ctypes.c_void_p(x.data_ptr())
