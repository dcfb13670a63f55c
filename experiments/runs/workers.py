"""Work spread over processes: one progress bar, results as they come, no orphans, no crowd."""

from __future__ import annotations

import multiprocessing
import os
import signal
import sys
import threading
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from pathlib import Path
from queue import Empty
from typing import Any, TypeVar

import torch

from mann_torch.errors import SolverError

from .progress import progress_bar

Result = TypeVar("Result")
#: What a worker counts before it tells the bar.
REPORT_EVERY = 1000
#: The most workers of this process; None: as many as are asked for.
_most: int | None = None


@contextmanager
def at_most(count: int | None) -> Iterator[None]:
    """Start no more workers than this: of several jobs side by side, each has a share of cores."""
    global _most
    before, _most = _most, count
    try:
        yield
    finally:
        _most = before


def in_parallel(
    work: Callable[..., Result],
    arguments: Sequence[tuple[Any, ...]],
    workers: int,
    total: int,
    unit: str,
    report_every: int = REPORT_EVERY,
) -> Iterator[tuple[int, Result]]:
    """`work(*arguments[i], progress)` for every i: (i, result) in the order they become ready.

    `work` calls `progress(count)`; `total` counts make the bar full. On an error or Ctrl-C nobody
    waits for what is queued or running, and workers do not outlive this process. Raises
    `SolverError` where a worker died.
    """
    workers = workers if _most is None else min(workers, _most)
    with progress_bar(total, unit) as bar:
        if workers == 1 or len(arguments) == 1:
            for number, given in enumerate(arguments):
                yield number, work(*given, bar.update)
            return
        context = multiprocessing.get_context("spawn")
        counts = context.Queue()
        pool = ProcessPoolExecutor(
            min(workers, len(arguments)),
            mp_context=context,
            initializer=_start_worker,
            initargs=(counts,),
        )
        waiting: dict[Future[Result], int] = {}
        try:
            for number, given in enumerate(arguments):
                waiting[pool.submit(_call, work, given, report_every)] = number
            while waiting:
                _drain(counts, bar.update)
                for future in [future for future in waiting if future.done()]:
                    yield waiting.pop(future), future.result()
        except BrokenProcessPool:
            raise SolverError("a worker process died (out of memory?): try workers=1") from None
        finally:
            running = list((pool._processes or {}).values()) if waiting else []
            pool.shutdown(wait=not waiting, cancel_futures=True)
            for worker in running:
                worker.terminate()


#: Where this worker reports its progress; set once, when it starts.
_counts: Any = None


def _start_worker(counts: Any) -> None:
    global _counts
    _counts = counts
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the parent alone answers Ctrl-C
    threading.Thread(target=_end_with_parent, daemon=True).start()
    # Compile in this process: the other core is busy with the other worker.
    os.environ["TORCHINDUCTOR_COMPILE_THREADS"] = "1"


def _end_with_parent() -> None:
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)


def _call(work: Callable[..., Result], given: tuple[Any, ...], report_every: int) -> Result:
    torch.set_num_threads(1)  # the other cores have their own workers
    pending = 0

    def progress(count: int = 1) -> None:
        nonlocal pending
        pending += count
        if pending >= report_every:
            _counts.put(pending)
            pending = 0

    result = work(*given, progress)
    _counts.put(pending)
    return result


def _drain(counts: Any, update: Callable[[int], object]) -> None:
    try:
        update(counts.get(timeout=0.5))
        while True:
            update(counts.get_nowait())
    except Empty:
        pass


def peak_mb() -> float:
    """Peak memory of this process [MB]; NaN where the system does not tell.

    Linux hands `ru_maxrss` of a process on to what it starts; the high water mark is its own.
    """
    status = Path("/proc/self/status")
    if status.exists():
        for row in status.read_text().splitlines():
            if row.startswith("VmHWM:"):
                return int(row.split()[1]) / 1024
    if sys.platform == "win32":
        return float("nan")
    import resource

    most = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return most / 1024**2 if sys.platform == "darwin" else most / 1024
