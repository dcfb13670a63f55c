"""Launches on all cores: Warp's CPU launches use one core and hold no GIL."""

from __future__ import annotations

import functools
import os
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor, wait
from contextlib import contextmanager, suppress

import torch

#: Seconds that one launch should take: progress shows, and Ctrl-C is heard.
PAUSE = 0.25
#: Steps of the first launch, if a state and what a step needs are no more numbers than `SMALL`;
#: and groups times steps of it, where nobody watches the progress.
FIRST, SMALL, UNWATCHED = 64, 4096, 2048


@contextmanager
def torch_on_one_thread() -> Iterator[None]:
    """Torch's own idle threads spin for a while after each operation, on the kernel's cores.

    Only in the main thread: another one would pass the setting on to threads started meanwhile.
    """
    before = torch.get_num_threads()
    alone = threading.current_thread() is threading.main_thread()
    if alone:
        torch.set_num_threads(1)
    try:
        yield
    finally:
        if alone:
            torch.set_num_threads(before)


@functools.cache
def _pool(size: int, process: int) -> ThreadPoolExecutor:
    return ThreadPoolExecutor(size, thread_name_prefix="compiled")


def pool(size: int) -> ThreadPoolExecutor:
    """Threads that run launches side by side; a fork has none of its parent's."""
    return _pool(size, os.getpid())


def run_all(launches: Sequence[Callable[[int, int], None]], first: int, last: int) -> None:
    """One launch on each core, this one too, over a range of steps."""
    if len(launches) == 1:
        launches[0](first, last)
        return
    others = pool(len(launches) - 1)
    done = [others.submit(launch, first, last) for launch in launches[1:]]
    try:
        launches[0](first, last)
        wait(done)
    finally:
        while not all(future.done() for future in done):  # Ctrl-C: they still use our memory
            with suppress(KeyboardInterrupt):
                wait(done)
    for future in done:
        future.result()


def first_steps(numbers: int, groups: float, watched: bool) -> int:
    """Steps of the first launch, of so many numbers a step and groups a core."""
    if numbers > SMALL:
        return 1
    return FIRST if watched else max(FIRST, int(UNWATCHED / groups))


def run_in_pieces(
    count: int,
    size: int,
    run: Callable[[int, int], None],
    progress: Callable[[int], object] | None = None,
) -> None:
    """Cover 0 to `count` in ranges that take about `PAUSE` each, the first one of `size`."""
    first = 0
    while first < count:
        last = min(first + size, count)
        begun = time.perf_counter()
        run(first, last)
        spent = time.perf_counter() - begun
        if progress is not None:
            progress(last - first)
        size = max(1, int(size * min(16.0, PAUSE / max(spent, 1e-6))))
        first = last
