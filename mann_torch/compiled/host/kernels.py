"""The one place that knows Warp: C++ text in, a callable kernel out.

A kernel's text is a native function's body; it is compiled by Warp's own compiler, on CPU and
CUDA, and cached on disk under a name made of all that it depends on: where Warp keeps its kernels
(`WARP_CACHE_PATH`), or in a temporary folder if nothing can be written there.
"""

from __future__ import annotations

import functools
import hashlib
import logging
import os
import sys
import tempfile
import threading
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from typing import Any

import torch
from torch import Tensor

from ...errors import KernelError
from .cache import loaded_safely, temporary_folder
from .launching import direct, launch, recorded, single

log = logging.getLogger("mann_torch")
#: Warp may be started, and a kernel built, by one thread at a time.
LOCK = threading.RLock()
#: One lane: the compiler finds vectors along loops over elements. Several: they are the vectors,
#: and looking for more costs time.
_FLAGS = {
    True: "-march=native -mllvm=-inline-threshold=9000",
    False: "-march=native -mllvm=-inline-threshold=9000 -fno-slp-vectorize -fno-vectorize",
}


def missing() -> str | None:
    """None once Warp runs here, else why it does not."""
    with LOCK:
        return _start()


@functools.cache
def _start() -> str | None:
    try:
        with _silent_stderr():
            import warp as wp

            wp.config.log_level = max(wp.config.log_level, wp.LOG_WARNING)
            news = _usable_cache(wp)
            wp.init()
    except Exception as error:  # a missing wheel, a foreign platform
        return f"warp-lang cannot be used ({type(error).__name__}: {error})"
    if news is not None:
        log.warning(news)
    return None


def _usable_cache(wp: Any) -> str | None:
    """Before Warp starts: a temporary folder where its own can't be written; then, the news."""
    from warp._src.build import init_kernel_cache

    try:
        init_kernel_cache(_wanted(wp))
        with tempfile.NamedTemporaryFile(dir=wp.config.kernel_cache_dir):
            return None
    except OSError as error:
        room = wp.config.kernel_cache_dir = str(temporary_folder(os.getpid()))
        init_kernel_cache(room)
        return f"no kernels can be kept ({error}); until this process ends they are in {room}"


def _wanted(wp: Any) -> str:
    from warp._src.thirdparty import appdirs

    chosen = wp.config.kernel_cache_dir or os.environ.get("WARP_CACHE_PATH")
    if chosen:
        return str(chosen)
    for usual in (appdirs.user_cache_dir("warp", "NVIDIA"), os.path.expanduser("~/.cache/warp")):
        if os.path.isabs(usual):  # Warp would take the working directory
            return usual
    raise OSError("no home folder is known")


@contextmanager
def _silent_stderr() -> Iterator[None]:
    """Drop what native code prints: Warp warns on stderr wherever there is no CUDA driver."""
    sys.stderr.flush()
    try:
        kept = os.dup(2)
    except OSError:  # no stderr at all
        yield
        return
    sink = os.open(os.devnull, os.O_WRONLY)
    try:
        os.dup2(sink, 2)
        yield
    finally:
        os.dup2(kept, 2)
        os.close(kept)
        os.close(sink)


@functools.cache
def lanes_here(bytes_each: int = 8) -> int:
    """How many lanes of so many bytes, 8 for float64, this machine computes side by side."""
    capability = torch.backends.cpu.get_cpu_capability()
    return {"AVX512": 64, "AVX2": 32}.get(capability, 16) // bytes_each


class Kernel:
    """A compiled kernel: call it with a table of pointers and a range of groups and steps."""

    def __init__(self, made: Any, device: str) -> None:
        self._made, self._device = made, device

    def prepared(self, table: Tensor, offset: int, count: int) -> Callable[[int, int], None]:
        """A launch over `count` groups from number `offset` on, to be run for ranges of steps.

        Packing the arguments each time would take a millisecond.
        """
        found = direct(self._made, count) if self._device == "cpu" else None
        if found is not None:
            return launch(found, table, offset)
        command = recorded(self._made, table, offset, count, self._device)

        def run(first: int, last: int) -> None:
            command.set_param_at_index(2, first)
            command.set_param_at_index(3, last)
            command.launch()

        return run

    def single(self, table: Tensor, count: int = 1) -> Callable[[], Any]:
        """One step of `count` groups, as often as it is called: nothing is packed again.

        What the table points at must live as long.
        """
        found = direct(self._made, count) if self._device == "cpu" else None
        if found is None:
            return functools.partial(self.prepared(table, 0, count), 0, 1)
        return single(found, table)


def kernel(text: str, lanes: int, device: str = "cpu") -> Kernel:
    """The kernel of a text, compiled at most once a process.

    Raises `KernelError` where it cannot be compiled or loaded.
    """
    with LOCK:
        made = _build(text, lanes, device)
    if isinstance(made, KernelError):
        raise made
    return Kernel(made, device)


@functools.lru_cache(maxsize=512)
def _build(text: str, lanes: int, device: str) -> Any:
    """The kernel, or the error that comes instead, so that no failure is tried twice.

    A full disk or a folder gone may be better next time: that `KernelError` is raised.
    """
    trouble = missing()
    if trouble is not None:
        return KernelError(trouble)
    import warp as wp

    from .warp_kernel import declare

    name = "march_" + hashlib.sha256(text.encode()).hexdigest()[:24]
    options = {"cpu_compiler_flags": _FLAGS[lanes == 1], "fuse_fp": False}
    try:
        return loaded_safely(declare(name, text, options), wp, device)
    except OSError as error:
        raise _refusal(device, error) from error
    except Exception as error:  # Warp raises bare exceptions: no compiler, a text it can't take
        return _refusal(device, error)


def _refusal(device: str, error: Exception) -> KernelError:
    cause = str(error).strip().splitlines() or ["no message"]
    return KernelError(f"the compiled kernel cannot be built on {device}: {cause[0]}")


def on_stream(device: str) -> AbstractContextManager[Any]:
    """On a GPU, Warp works on torch's current stream."""
    if device == "cpu":
        return nullcontext()
    import warp as wp

    return wp.ScopedStream(wp.stream_from_torch(torch.cuda.current_stream(device)))
