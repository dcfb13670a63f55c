"""What a run would need, beside what the machine has: refused before it begins."""

from __future__ import annotations

import os
import sys
import zipfile
from pathlib import Path

from mann_torch.errors import ConfigError

GB = 1e9
#: What a worker process holds before it has done anything: torch, mostly.
WORKER = 0.3 * GB
MOST_WORKERS = 256
#: Objects that a file's bytes become: a number of a JSON text takes about that much more.
_UNFOLDED = 4
_CONTAINER = (
    Path("/sys/fs/cgroup/memory.max"),
    Path("/sys/fs/cgroup/memory/memory.limit_in_bytes"),
)


def machine_memory() -> float:
    """Bytes that this process may ever have: the machine's, its container's or its shell's."""
    limits = [float("inf")]
    if "SC_PHYS_PAGES" in getattr(os, "sysconf_names", {}):
        limits.append(float(os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")))
    for path in _CONTAINER:
        try:
            limits.append(float(path.read_text()))
        except (OSError, ValueError):  # no container, or one without a limit ("max")
            continue
    if sys.platform != "win32":
        import resource

        soft, _ = resource.getrlimit(resource.RLIMIT_AS)
        if soft != resource.RLIM_INFINITY:
            limits.append(float(soft))
    return min(limits)


def check_memory(what: str, needed: float) -> None:
    """Raise `ConfigError` where `what` takes more bytes than there are."""
    there = machine_memory()
    if needed > there:
        raise ConfigError(
            f"{what}: needs {needed / GB:.3g} GB of memory or more, this machine has "
            f"{there / GB:.3g} GB"
        )


def check_file(what: str, path: Path) -> None:
    """Raise `ConfigError` for a file from elsewhere whose content has no room here.

    A zip archive counts with what it unfolds to; what can't be read is for its reader to tell.
    """
    try:
        size = float(path.stat().st_size)
        if zipfile.is_zipfile(path):
            with zipfile.ZipFile(path) as archive:
                size = float(sum(member.file_size for member in archive.infolist()))
    except (OSError, ValueError, NotImplementedError, zipfile.BadZipFile):
        return
    check_memory(f"{what} {path}", size * _UNFOLDED)


def check_workers(workers: int) -> None:
    """Raise `ConfigError` for no worker process, or more than can live side by side."""
    if not 1 <= workers <= MOST_WORKERS:
        raise ConfigError(f"workers = {workers}: must be 1 to {MOST_WORKERS}")
    check_memory(f"workers = {workers}", workers * WORKER)
