"""An exported controller compiled, loaded and called from Python."""

from __future__ import annotations

import ctypes
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest
import torch
from torch import Tensor

import mann_torch as mt
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
    """The functions of a folder, with fma where there is one."""

    def __init__(self, stepper: mt.Stepper, folder: Path, settable: bool, *flags: str) -> None:
        library = folder / f"lib{NAME}_{len(list(folder.iterdir()))}.so"
        source = str(folder / f"{NAME}.c")
        command = [needs("gcc"), *FLAGS, "-O2", *(flags or FMA), "-shared", "-fPIC", source]
        subprocess.run([*command, "-o", str(library), "-lm"], check=True)
        self._c = ctypes.CDLL(str(library))
        form = form_of(stepper, NAME, "struct" if settable else "baked", True)
        self._form, self._dtype = form, np.dtype(f"f{form.real.bytes}")
        self._bytes = form.bytes
        self._state = np.zeros(
            (form.size("f") + max(form.size("k"), 1)) * form.real.bytes, np.uint8
        )
        count = form.count("f") + form.count("k")
        self.constants: np.ndarray | None = None
        if settable:
            kind = ctypes.c_char * (count * form.real.bytes)
            defaults = self._c.ctl_default_constants
            defaults.restype = type("Constants", (ctypes.Structure,), {"_fields_": [("x", kind)]})
            self.constants = np.frombuffer(bytes(defaults()), self._dtype).copy()

    def _call(self, function: str, *arrays: np.ndarray, adapt: bool | None = None) -> int:
        given = [self._state] if self.constants is None else [self._state, self.constants]
        out = [] if adapt is None else [ctypes.c_int(adapt), _at(arrays[-1])]
        ins = arrays if adapt is None else arrays[:-1]
        return getattr(self._c, f"ctl_{function}")(*map(_at, [*given, *ins]), *out)

    def init(self, reference: Tensor, measurement: Tensor, how: str = "init") -> None:
        self._call(how, reference.numpy(), measurement.numpy())

    def step(
        self, reference: Tensor, measurement: Tensor, adapt: bool = True
    ) -> tuple[Tensor, int]:
        out = np.zeros(len(self._form.ports.input), self._dtype)
        flags = self._call("step", reference.numpy(), measurement.numpy(), out, adapt=adapt)
        return torch.from_numpy(out), flags

    def save(self) -> bytes:
        room = np.zeros(self._bytes, np.uint8)
        self._c.ctl_save(_at(self._state), _at(room))
        return room.tobytes()

    def restore(self, data: bytes) -> int:
        return self._c.ctl_restore(_at(self._state), _at(np.frombuffer(data, np.uint8)))


def _at(x: np.ndarray) -> ctypes.c_void_p:
    return ctypes.c_void_p(x.ctypes.data)
