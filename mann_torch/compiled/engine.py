"""Runs kernels over a batch: lanes packed, cores shared out, launches short enough to interrupt."""

from __future__ import annotations

import functools
import struct
import threading
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor, wait
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import pairwise

import torch
from torch import Tensor

from ..errors import KernelError
from .cpp.march import FINE
from .host import Kernel, kernel, lanes_here
from .program import Program

#: Steps times samples of one launch on a core: about half a second, so that progress shows and
#: Ctrl-C is heard.
LAUNCH_WORK = 1_000_000
#: Bytes of working memory that one core may use.
ROOM = 2**30


@dataclass(frozen=True)
class Job:
    """One march of a program, apart from what gradients reach.

    Kept rows: `motion_slot` and `state_slot` (T+1,) int32 name the row a step time is kept in, -1
    for none.
    """

    program: Program
    clock: Tensor  # (T, C)
    segment_of: Tensor  # (T,) int32, row of the segments in force in a step
    noise: tuple[Tensor, Tensor, Tensor] | None  # table (R, K, W), row (B,), instant (T,) int32
    whole: Tensor  # (B, N) int64, constants that are integers or masks; a mask is 0 or -1
    carry_k: Tensor  # (B, K) int64, the same
    motion_slot: Tensor
    state_slot: Tensor
    limit: float
    tape_memory: float  # [bytes]
    wanted: tuple[tuple[int, ...], tuple[int, ...]]  # constants, segments with gradients
    progress: Callable[[int], object] | None = None
    lanes: int | None = None  # None: as many as serve the batch

    @property
    def lanes_used(self) -> int:
        """Lanes of a group."""
        return self.lanes or lanes_for(self.program, len(self.carry_k), torch.get_num_threads())

    @property
    def n_steps(self) -> int:
        """T."""
        return len(self.clock)


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
    """Threads that run launches side by side: Warp's CPU launches use one core and no GIL."""
    return ThreadPoolExecutor(size, thread_name_prefix="compiled")


def lanes_for(program: Program, batch: int, threads: int) -> int:
    """Lanes to a group: as many as the machine has, one where cores alone serve the batch.

    Fewer where the working memory of a step would be too large.
    """
    lanes = 1 if batch <= 2 * threads else lanes_here()
    while lanes > 1 and 8 * lanes * program.forward(lanes).heap > ROOM:
        lanes = max(1, lanes // 8 if lanes == 8 else 1)
    return lanes


def to_lanes(x: Tensor, lanes: int) -> Tensor:
    """(..., B, n) -> (..., G, n, L), the last sample again where lanes are left over."""
    batch = x.shape[-2]
    groups = -(-batch // lanes)
    if groups * lanes != batch:
        last = x[..., -1:, :].expand(*x.shape[:-2], groups * lanes - batch, x.shape[-1])
        x = torch.cat([x, last], dim=-2)
    x = x.unflatten(-2, (groups, lanes))
    return x.mT.contiguous()


def from_lanes(x: Tensor, batch: int) -> Tensor:
    """The inverse of `to_lanes`."""
    return x.mT.flatten(-3, -2)[..., :batch, :]


class Marcher:
    """Buffers and launches of one march."""

    def __init__(
        self, job: Job, constants: Tensor, segments: Tensor, carry: Tensor, backward: bool
    ) -> None:
        self.job, self.batch = job, len(carry)
        layout = job.program.layout
        self._lanes = lanes = job.lanes_used
        self._groups = -(-self.batch // lanes)
        parts = min(torch.get_num_threads(), self._groups)
        edges = [self._groups * part // parts for part in range(parts + 1)]
        self._shares = [(low, high - low) for low, high in pairwise(edges)]
        self._constants, self._segments = to_lanes(constants, lanes), to_lanes(segments, lanes)
        self._whole = to_lanes(job.whole, lanes)
        self._f, self._k = to_lanes(carry, lanes), to_lanes(job.carry_k, lanes)
        f, k, doubles = layout.size("f"), layout.size("k"), {"dtype": torch.float64}
        self.motion = torch.empty(_rows(job.motion_slot), self.batch, layout.n_motion, **doubles)  # type: ignore[call-overload]
        self.state_f = torch.empty(_rows(job.state_slot), self.batch, f, **doubles)  # type: ignore[call-overload]
        self.state_k = torch.empty(_rows(job.state_slot), self.batch, k, dtype=torch.int64)
        self.stop = torch.full((self._groups * lanes,), job.n_steps, dtype=torch.int32)
        self.cause = torch.zeros(self._groups * lanes, dtype=torch.int32)
        self._limit = torch.tensor([job.limit], **doubles)  # type: ignore[arg-type]
        table, row, instant = job.noise or (torch.zeros(0), torch.zeros(0), torch.zeros(0))
        self._noise = table.contiguous(), _padded(row.int(), self._groups * lanes), instant
        self._stride = FINE
        self._kept: tuple[Tensor, Tensor] | None = None
        if backward:
            self._keep(f, k)

    def _keep(self, f: int, k: int) -> None:
        """Room for checkpoints: every FINE steps, or as far apart as memory asks."""
        size = 8 * self._lanes * self._groups * (f + k)
        steps = self.job.n_steps
        while self._stride < steps and -(-steps // self._stride) * size > self.job.tape_memory:
            self._stride *= 2
        count = -(-steps // self._stride)
        shape = (count, self._groups)
        self._kept = (
            torch.empty(*shape, f, self._lanes, dtype=torch.float64),
            torch.empty(*shape, k, self._lanes, dtype=torch.int64),
        )

    def _table(self, heap: Tensor, more: Sequence[Tensor | None] = ()) -> Tensor:
        job = self.job
        table, row, instant = self._noise
        instants = table.shape[1] if table.dim() == 3 else 0
        f, k = self._kept if self._kept is not None else (None, None)
        numbers = [self.batch, self._groups, job.n_steps, instants, self._stride]
        tensors = [
            self._limit, job.clock, self._constants, self._segments, job.segment_of, table, row,
            instant, self._f, self._k, self.motion, job.motion_slot, self.state_f, self.state_k,
            job.state_slot, self.stop, self.cause, f, k, heap, self._whole,
        ]  # fmt: skip
        pointers = [0 if t is None else t.data_ptr() for t in tensors]
        pointers.append(0)  # all groups of a core share its working memory
        pointers += [0 if t is None else t.data_ptr() for t in more]
        packed = struct.pack(f"{len(numbers) + len(pointers)}Q", *numbers, *pointers)
        return torch.frombuffer(bytearray(packed), dtype=torch.int64)

    def _heap(self, vectors: int) -> Tensor:
        bytes_ = 8 * self._lanes * vectors
        if bytes_ > 4 * ROOM:
            raise KernelError(
                f"a step of this size needs {bytes_ / 2**30:.1f} GiB of working memory on each "
                f"core; the compiled engine's limit is {4 * ROOM / 2**30:.0f} GiB: "
                "fewer slots or neurons, or engine='torch'"
            )
        return torch.empty(max(vectors, 1) * self._lanes, dtype=torch.float64)

    @torch_on_one_thread()
    def forward(self) -> None:
        """All steps."""
        job = self.job
        text = job.program.forward(self._lanes)
        launches = self._launches(kernel(text.text, self._lanes), text.heap, ())
        stride = max(FINE, LAUNCH_WORK * len(self._shares) // self.batch)
        if job.progress is None and job.n_steps < 2 * stride:
            stride = max(job.n_steps, 1)
        for first in range(0, job.n_steps, stride):
            last = min(first + stride, job.n_steps)
            _all(launches, first, last)
            if job.progress is not None:
                job.progress(last - first)

    def _launches(
        self, made: Kernel, heap: int, more: Sequence[Tensor | None]
    ) -> list[Callable[[int, int], None]]:
        rooms = [self._heap(heap) for _ in self._shares]
        tables = [self._table(room, more) for room in rooms]
        self._alive = (rooms, tables, more)  # the kernels see addresses alone
        return [
            made.prepared(table, *share) for table, share in zip(tables, self._shares, strict=True)
        ]

    @torch_on_one_thread()
    def gradient(
        self, motion: Tensor | None, state: Tensor | None
    ) -> tuple[Tensor, Tensor, Tensor]:
        """Gradients of wanted constants (B, P), segments (S, B, Q) and the first carry (B, F)."""
        job, lanes = self.job, self._lanes
        text = job.program.backward(lanes, *job.wanted)
        made = kernel(text.text, lanes)
        P = len(job.program.constant_columns(job.wanted[0]))
        Q = len(job.program.segment_columns(job.wanted[1]))
        adj = torch.zeros_like(self._f)
        found_c = adj.new_zeros(self._groups, P, lanes)
        found_s = adj.new_zeros(len(self._segments), self._groups, Q, lanes)
        given = [None if g is None else g.contiguous() for g in (motion, state)]
        f, k = job.program.layout.size("f"), job.program.layout.size("k")
        heap = text.heap + (self._stride // FINE) * (f + k)
        launches = self._launches(made, heap, (adj, found_c, found_s, *given))
        blocks = -(-job.n_steps // self._stride)
        span = max(1, LAUNCH_WORK * len(self._shares) // (4 * self.batch * self._stride))
        for last in range(blocks, 0, -span):
            _all(launches, max(0, last - span), last)
        return (
            from_lanes(found_c, self.batch),
            from_lanes(found_s, self.batch),
            from_lanes(adj, self.batch),
        )

    def last(self) -> tuple[Tensor, Tensor]:
        """The carry after the last step, (B, F) and (B, K)."""
        return from_lanes(self._f, self.batch), from_lanes(self._k, self.batch)

    def forget_outputs(self) -> None:
        """Let go of the outputs, which refer back to this object through their gradient."""
        self.motion, self.state_f = self.motion[:0], self.state_f[:0]


def _all(launches: Sequence[Callable[[int, int], None]], first: int, last: int) -> None:
    """One launch on each core."""
    if len(launches) == 1:
        launches[0](first, last)
        return
    done = [pool(len(launches)).submit(launch, first, last) for launch in launches]
    wait(done)
    for future in done:
        future.result()


def _rows(slots: Tensor) -> int:
    return int(slots.max()) + 1


def _padded(row: Tensor, count: int) -> Tensor:
    if len(row) in (0, count):
        return row
    return torch.cat([row, row[-1:].expand(count - len(row))])
