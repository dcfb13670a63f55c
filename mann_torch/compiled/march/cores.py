"""Launches on all cores: Warp's CPU launches use one core and hold no GIL."""

from __future__ import annotations

import functools
import threading
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor, wait
from contextlib import contextmanager

import torch


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
def pool(size: int) -> ThreadPoolExecutor:
    """Threads that run launches side by side."""
    return ThreadPoolExecutor(size, thread_name_prefix="compiled")


def run_all(launches: Sequence[Callable[[int, int], None]], first: int, last: int) -> None:
    """One launch on each core, over a range of steps."""
    if len(launches) == 1:
        launches[0](first, last)
        return
    done = [pool(len(launches)).submit(launch, first, last) for launch in launches]
    wait(done)
    for future in done:
        future.result()
