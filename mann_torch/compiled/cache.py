"""Kernels on disk that can be trusted: locked while they are made, sealed with their hashes.

Warp reads whatever lies in its cache. A file cut short by a full disk or garbled would be an error
for ever, or worse. So each kernel's folder gets a seal, the hashes of its files; a folder whose
files differ from their seal is thrown away and made anew. A lock on a file beside it, which ends
with its process, keeps several processes from building or mending the same folder at once.
"""

from __future__ import annotations

import hashlib
import json
import logging
import os
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

log = logging.getLogger("mann_torch")
_SEAL = "seal.json"


def usable_cache(wp: Any) -> None:
    """Before Warp starts: let it use a temporary folder where its own can't be written."""
    from warp._src.build import init_kernel_cache

    wanted = wp.config.kernel_cache_dir or os.environ.get("WARP_CACHE_PATH")
    try:
        init_kernel_cache(wanted)
        folder = Path(wp.config.kernel_cache_dir)
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.NamedTemporaryFile(dir=folder):
            pass
    except OSError as error:
        room = tempfile.mkdtemp(prefix="mann_torch_kernels_")
        log.warning("no kernels can be kept (%s); they go to %s", error, room)
        wp.config.kernel_cache_dir = room
        init_kernel_cache(room)


def loaded_safely(made: Any, wp: Any, device: str) -> Any:
    """A declared kernel, compiled if need be, and loaded."""
    module = made.module
    folder = Path(wp.config.kernel_cache_dir) / module.get_module_identifier(_block(wp, device))
    with _locked(folder):
        if folder.exists() and not _sound(folder):
            shutil.rmtree(folder, ignore_errors=True)
        try:
            wp.force_load(device=device, modules=[module])
        except Exception:  # files that changed under our hands: once more, from nothing
            shutil.rmtree(folder, ignore_errors=True)
            module.mark_modified()
            wp.force_load(device=device, modules=[module])
        if folder.exists():
            _seal(folder)
    return made


def _block(wp: Any, device: str) -> int | None:
    return 1 if device == "cpu" else None


def _hashes(folder: Path) -> dict[str, str]:
    files = sorted(p for p in folder.iterdir() if p.is_file() and p.name != _SEAL)
    files = [p for p in files if not p.name.startswith(".")]
    return {p.name: hashlib.sha256(p.read_bytes()).hexdigest() for p in files}


def _sound(folder: Path) -> bool:
    """Whether every sealed file is there and as it was."""
    try:
        sealed = json.loads((folder / _SEAL).read_text())
        found = _hashes(folder)
    except (OSError, ValueError):
        return False
    return bool(sealed) and all(found.get(name) == value for name, value in sealed.items())


def _seal(folder: Path) -> None:
    try:
        if _sound(folder):
            return
        part = folder / f".{_SEAL}.{os.getpid()}"
        part.write_text(json.dumps(_hashes(folder)))
        os.replace(part, folder / _SEAL)
    except OSError:  # a full disk: the next process compiles again
        return


@contextmanager
def _locked(folder: Path) -> Iterator[None]:
    """Only one process at a time; without a lock where the system has none."""
    try:
        import fcntl

        folder.parent.mkdir(parents=True, exist_ok=True)
        handle = open(folder.with_name(folder.name + ".lock"), "a")  # noqa: SIM115
    except (ImportError, OSError):
        yield
        return
    try:
        fcntl.flock(handle, fcntl.LOCK_EX)
        yield
    finally:
        handle.close()
