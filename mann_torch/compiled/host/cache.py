"""Kernels on disk that can be trusted: made and loaded in private, locked and sealed in public.

Warp reads whatever lies in its cache; a file cut short by a full disk or garbled would be an error
for ever, or worse, and LLVM ends the process where it cannot write. So Warp works in a temporary
folder of this process alone. From there a kernel is published: its folder is put into the cache in
one piece, with a seal, the hashes of its files. One that does not agree with its seal is made anew.
A lock beside it, which ends with its process, keeps others from making the same at once. Kernels
that nobody has used for `UNUSED` are thrown away when a process makes its first new one.
"""

from __future__ import annotations

import atexit
import errno
import functools
import hashlib
import json
import logging
import os
import shutil
import tempfile
import time
import uuid
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import IO, Any

log = logging.getLogger("mann_torch")
#: Bytes that must be free before anything is compiled.
FREE = 16 * 2**20
#: After this long without use a kernel is thrown away [s].
UNUSED = 90 * 24 * 3600.0
#: How long to wait for another process that compiles, and when it must have ended [s].
PATIENCE, STALE = 60.0, 24 * 3600.0
#: What a process makes and removes itself begins like this.
OWN = "mann_torch_kernels_"
_SEAL = "seal.json"
_OWNED = "owner.lock"


def loaded_safely(made: Any, wp: Any, device: str) -> Any:
    """A declared kernel, compiled if need be, and loaded.

    Raises `OSError` where it has no room, and what Warp raises where it can't be compiled.
    """
    module, cache = made.module, Path(wp.config.kernel_cache_dir)
    module.mark_modified()  # Warp remembers failures
    name = module.get_module_identifier(1 if device == "cpu" else None)
    with _locked(_lock_of(cache / name)):
        sealed = _sealed(cache / name)
        room = _room(cache, sealed)
        try:
            _fill(room / name, sealed)
            wp.config.kernel_cache_dir = str(room)
            wp.force_load(device=device, modules=[module])
            _publish(room / name, cache / name, sealed)
        finally:
            wp.config.kernel_cache_dir = str(cache)
            shutil.rmtree(room / name, ignore_errors=True)
    return made


# -- folders --------------------------------------------------------------------------------------


def _files(folder: Path) -> dict[str, bytes]:
    return {p.name: p.read_bytes() for p in sorted(folder.iterdir()) if p.name != _SEAL}


def _hashes(files: dict[str, bytes]) -> dict[str, str]:
    return {name: hashlib.sha256(content).hexdigest() for name, content in files.items()}


def _sealed(folder: Path) -> dict[str, bytes]:
    """Files of a folder if all are as they were sealed, else none."""
    try:
        files, seal = _files(folder), folder / _SEAL
        if json.loads(seal.read_bytes()) == _hashes(files):
            if time.time() - seal.stat().st_mtime > 24 * 3600:
                with suppress(OSError):
                    os.utime(seal)  # in use
            return files
    except (OSError, ValueError, RecursionError):
        pass
    return {}


def _fill(folder: Path, files: dict[str, bytes]) -> None:
    if files:
        folder.mkdir(parents=True)
    for name, content in files.items():
        (folder / name).write_bytes(content)


def _publish(made: Path, folder: Path, before: dict[str, bytes]) -> None:
    """Put new files into the cache; where that fails, the next process compiles again."""
    part = folder.with_name(f".{OWN}{uuid.uuid4().hex}")
    try:
        files = _files(made) if made.exists() else before  # nothing where it was loaded already
        if files != before:
            _tidy(folder.parent)
            _fill(part, {**files, _SEAL: json.dumps(_hashes(files)).encode()})
            _remove(folder)
            os.rename(part, folder)
    except OSError as error:
        shutil.rmtree(part, ignore_errors=True)
        if error.errno not in (errno.ENOTEMPTY, errno.EEXIST):  # another process was faster
            _say(folder.parent, error.strerror)


@functools.cache
def _say(cache: Path, why: str) -> None:
    log.warning("no kernels can be kept in %s (%s): each process compiles its own", cache, why)


def _remove(path: Path) -> None:
    """A file or folder, which need not be there. Raises `OSError` where it stays."""
    if path.is_dir() and not path.is_symlink():
        shutil.rmtree(path)
    else:
        path.unlink(missing_ok=True)


@functools.cache
def _tidy(cache: Path) -> None:
    """Throw away what processes that were killed left behind, and kernels out of use."""
    for path in (*cache.glob(f"*{OWN}*"), *cache.glob("wp_march_*")):
        with suppress(OSError):
            seal = path / _SEAL
            age = time.time() - (seal if seal.exists() else path).stat().st_mtime
            if OWN in path.name and age > STALE:
                _remove(path)
            elif path.is_dir() and age > UNUSED:
                with _locked(_lock_of(path), 0.0) as alone:
                    if alone:
                        _remove(path)
                        _lock_of(path).unlink()


# -- room -----------------------------------------------------------------------------------------


def _room(cache: Path, files: dict[str, bytes]) -> Path:
    """A folder of this process alone, with room to compile in. Raises `OSError` without one."""
    need = sum(map(len, files.values())) + (0 if files else FREE)
    try:
        return _with_room(temporary_folder(os.getpid()), need)
    except OSError:
        return _with_room(temporary_folder(os.getpid(), cache), need)


def _with_room(folder: Path, need: int) -> Path:
    """The folder, if so many bytes can be written there."""
    folder.mkdir(parents=True, exist_ok=True)
    block = bytes(2**20)
    with tempfile.NamedTemporaryFile(dir=folder, buffering=0) as file:
        while file.tell() < need:
            file.write(block)
    return folder


@functools.cache
def temporary_folder(process: int, where: Path | None = None) -> Path:
    """A new folder that ends with this process."""
    if where is not None:
        where.mkdir(parents=True, exist_ok=True)
    made = tempfile.mkdtemp(prefix=OWN, dir=where)
    atexit.register(_forget, made, process)
    with suppress(ImportError, OSError):
        _held.append(_lock(Path(made) / _OWNED, time.monotonic()))
    _forget_killed(Path(made).parent)
    return Path(made)


#: Locks on this process's own folders: the system lets go of them however it ends.
_held: list[IO[bytes] | None] = []


def _forget_killed(where: Path) -> None:
    """Remove the folders of processes that ended without a word."""
    for path in where.glob(f"{OWN}*"):
        with suppress(OSError, ImportError):
            if not (path / _OWNED).exists():  # just made, or where no lock can be had
                gone = time.time() - path.stat().st_mtime > STALE
            else:
                lock = _lock(path / _OWNED, time.monotonic())
                gone = lock is not None
                if lock is not None:
                    lock.close()
            if gone:
                shutil.rmtree(path, ignore_errors=True)


def _forget(folder: str, process: int) -> None:
    if os.getpid() == process:  # not in a fork
        shutil.rmtree(folder, ignore_errors=True)


# -- locks ----------------------------------------------------------------------------------------


def _lock_of(folder: Path) -> Path:
    return folder.with_name(folder.name + ".lock")


@contextmanager
def _locked(path: Path, patience: float = PATIENCE) -> Iterator[bool]:
    """Only one process at a time; False where no lock can be had: renames must do then."""
    held = None
    with suppress(ImportError, OSError):
        held = _lock(path, time.monotonic() + patience)
    try:
        yield held is not None
    finally:
        if held is not None:
            import fcntl

            with held:
                fcntl.flock(held, fcntl.LOCK_UN)  # closing alone won't do: a fork may hold it too


def _lock(path: Path, until: float) -> IO[bytes] | None:
    import fcntl

    path.parent.mkdir(parents=True, exist_ok=True)
    while True:
        handle = open(path, "ab")  # noqa: SIM115
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
            if os.path.samestat(os.fstat(handle.fileno()), path.stat()):
                return handle
        except (BlockingIOError, FileNotFoundError):  # someone else's, or of a file that is gone
            pass
        except BaseException:
            handle.close()
            raise
        handle.close()
        if time.monotonic() > until:
            return None
        time.sleep(0.02)
