"""C99 text compiled by the compilers that are here, and called."""

from __future__ import annotations

import ctypes
import platform
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest

STRICT = (
    *("-std=c99", "-pedantic", "-Wall", "-Wextra", "-Werror"),
    *("-fno-math-errno", "-ffp-contract=off"),
)
X86 = platform.machine() in ("x86_64", "AMD64")
#: Flags of a machine with fma and of one without, where a compiler can choose.
FMA = ("-mfma",) if X86 else ()
NO_FMA = ("-mno-fma",) if X86 else ()


def needs(compiler: str) -> str:
    """The compiler's path; the test is skipped where there is none."""
    found = shutil.which(compiler)
    if found is None:
        pytest.skip(f"no C compiler {compiler} here")
    return found


def compiled(
    text: str, folder: Path, compiler: str = "gcc", *flags: str, strict: bool = True
) -> Path:
    """An object file of a text that draws no warning."""
    # A library is loaded once by its name, so each has one of its own.
    source = folder / f"text_{len(list(folder.iterdir()))}.c"
    made = source.with_suffix(".o")
    source.write_text(text)
    command = [needs(compiler), *(STRICT if strict else ()), "-O2", "-fPIC", *flags]
    done = subprocess.run(
        [*command, "-c", str(source), "-o", str(made)], capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr[:3000]
    assert not done.stderr
    return made


def loaded(made: Path, compiler: str = "gcc") -> ctypes.CDLL:
    """The functions of an object file."""
    library = made.with_suffix(".so")
    subprocess.run([needs(compiler), "-shared", str(made), "-o", str(library), "-lm"], check=True)
    return ctypes.CDLL(str(library))


def undefined(made: Path) -> set[str]:
    """What an object file wants of others, but for what compilers call by themselves."""
    done = subprocess.run(
        [needs("nm"), "-u", str(made)], capture_output=True, text=True, check=True
    )
    names = {line.split()[-1] for line in done.stdout.splitlines() if line.strip()}
    return names - {"memcpy", "memset", "_GLOBAL_OFFSET_TABLE_"}


def pointer(x: np.ndarray) -> ctypes.c_void_p:
    assert x.flags.c_contiguous
    return ctypes.c_void_p(x.ctypes.data)


def run_sanitized(text: str, folder: Path, compiler: str) -> None:
    """A whole program under the address and the undefined-behaviour sanitizer."""
    sanitizers = "-fsanitize=address,undefined"
    made = compiled(text, folder, compiler, sanitizers, "-fno-sanitize-recover=all", "-g")
    program = folder / "program"
    subprocess.run([needs(compiler), sanitizers, str(made), "-o", str(program), "-lm"], check=True)
    done = subprocess.run([str(program)], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr[:3000]
