"""Runs kernels over a batch: lanes packed, cores shared out, launches short enough to interrupt."""

from __future__ import annotations

import struct
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import torch
from torch import Tensor

from ...errors import KernelError
from ..host.kernels import Kernel, kernel, on_stream
from .cores import first_steps, run_all, run_in_pieces, torch_on_one_thread
from .kernel_text import is_turned
from .layout import Moved
from .loop_forms import SHARED
from .loop_text import FINE
from .packing import from_lanes, lanes_for, padded, to_lanes
from .program import Program
from .rooms import ROOMS
from .scope import Back

#: Bytes of working memory, of a core and of all that work at a time.
LIMIT = 2**32
#: Bytes of checkpoints, up to which there is one a step: no step is run again.
EVERY_STEP = 2**23


@dataclass(frozen=True)
class Job:
    """One march of a program, apart from what gradients reach.

    Kept rows: `motion_slot` and `state_slot` (T+1,) int32 name the row a step time is kept in, -1
    for none.
    """

    program: Program
    clock: Tensor  # (T, C); floating tensors are of the program's dtype
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
    device: str = "cpu"

    @property
    def lanes_used(self) -> int:
        """Lanes of a group."""
        threads = torch.get_num_threads()
        return self.lanes or lanes_for(self.program, len(self.carry_k), threads, self.device)

    @property
    def n_steps(self) -> int:
        """T."""
        return len(self.clock)


class Marcher:
    """Buffers and launches of one march."""

    def __init__(self, job: Job, moved: Moved, backward: bool) -> None:
        constants, segments, carry, shared = moved
        self.job, self.batch = job, len(carry)
        layout = job.program.layout
        self._real = real = layout.real
        self._lanes = lanes = job.lanes_used
        self._groups = -(-self.batch // lanes)
        self._parts = min(torch.get_num_threads(), self._groups) if job.device == "cpu" else 1
        count, groups = self._groups * lanes, self._groups
        f, k = layout.size("f"), layout.size("k")
        self._constants = to_lanes(constants, lanes).to(job.device)
        #: Whether segments and outputs lie as rows, a sample each, not in lanes.
        self.turned = is_turned(layout)
        own = segments.contiguous() if self.turned else to_lanes(segments, lanes)
        self._segments = own.to(job.device)
        # A copy: the backward pass reads it again, after an optimizer's step perhaps.
        self._shared = shared.to(job.device, copy=True).contiguous()
        self._whole = to_lanes(job.whole.to(real.whole_dtype), lanes).to(job.device)
        self._f = to_lanes(carry, lanes).to(job.device)
        self._k = to_lanes(job.carry_k.to(real.whole_dtype), lanes).to(job.device)
        rows, whole = _rows(job.motion_slot), _rows(job.state_slot)
        self.motion = self._empty(rows, self.batch, layout.n_motion)
        self.state_f = self._empty(whole, self.batch, f)
        self.state_k = self._whole_empty(whole, self.batch, k)
        self.stop = torch.full((count,), job.n_steps, dtype=torch.int32, device=job.device)
        self.cause = torch.zeros(count, dtype=torch.int32, device=job.device)
        table, row, instant = job.noise or (torch.zeros(0), torch.zeros(0), torch.zeros(0))
        self._instants = table.shape[1] if table.dim() == 3 else 0
        fixed = (
            torch.tensor([job.limit], dtype=real.dtype), job.clock.to(real.dtype),
            job.segment_of, table, padded(row.int(), count), instant, job.motion_slot,
            job.state_slot,
        )  # fmt: skip
        self._fixed = [x.contiguous().to(job.device) for x in fixed]
        self._stride = FINE
        self._kept: tuple[Tensor | None, Tensor | None] = (None, None)
        if backward:
            self._keep(groups, f, k)
            self._heap_size(self._backward_heap())  # too large shows before the forward pass

    def _empty(self, *shape: int) -> Tensor:
        return torch.empty(shape, dtype=self._real.dtype, device=self.job.device)

    def _lent(self, *shape: int, whole: bool = False) -> Tensor:
        """Memory of this march alone, which nothing that it gives away may share."""
        dtype = self._real.whole_dtype if whole else self._real.dtype
        if self.job.device != "cpu":
            return torch.empty(shape, dtype=dtype, device=self.job.device)
        return ROOMS.lend(self, shape, dtype)

    def _whole_empty(self, *shape: int) -> Tensor:
        return torch.empty(shape, dtype=self._real.whole_dtype, device=self.job.device)

    def _keep(self, groups: int, f: int, k: int) -> None:
        """Room for checkpoints: every FINE steps, or as far apart as memory asks."""
        size = self._real.bytes * self._lanes * groups * (f + k)
        steps = self.job.n_steps
        if steps * size <= min(EVERY_STEP, self.job.tape_memory):
            self._stride = 1
        while self._stride < steps and -(-steps // self._stride) * size > self.job.tape_memory:
            self._stride *= 2
        count = -(-steps // self._stride)
        whole = self._lent(count, groups, k, self._lanes, whole=True)
        self._kept = (self._lent(count, groups, f, self._lanes), whole)

    def _table(self, heap: Tensor, vectors: int, more: Sequence[Tensor | None]) -> Tensor:
        """Numbers and pointers as `loop_text` reads them."""
        limit, clock, segment_of, table, row, instant, motion_slot, state_slot = self._fixed
        numbers = [self.batch, self._groups, self.job.n_steps, self._instants, self._stride]
        tensors = [
            limit, clock, self._constants, self._segments, segment_of, table, row, instant,
            self._f, self._k, self.motion, motion_slot, self.state_f, self.state_k, state_slot,
            self.stop, self.cause, *self._kept, heap, self._whole,
        ]  # fmt: skip
        pointers = [0 if t is None else t.data_ptr() for t in tensors]
        # The groups of a core share its working memory, those of a GPU have each their own.
        pointers.append(0 if self.job.device == "cpu" else vectors)
        given = [*more[:-1], *[None] * (SHARED - len(numbers) - len(pointers) - len(more) + 1)]
        pointers += [0 if t is None else t.data_ptr() for t in (*given, self._shared, more[-1])]
        packed = struct.pack(f"{len(numbers) + len(pointers)}Q", *numbers, *pointers)
        return torch.frombuffer(bytearray(packed), dtype=torch.int64).to(self.job.device)

    def _backward_heap(self) -> int:
        """Vectors that the backward march wants."""
        layout = self.job.program.layout
        fine = (self._stride // FINE) * (layout.size("f") + layout.size("k"))
        return self.job.program.backward(self._lanes, *self.job.wanted).heap + fine

    def _heap_size(self, vectors: int) -> int:
        """Bytes of a core's working memory."""
        size = self._real.bytes * self._lanes * vectors
        if size > LIMIT:
            raise KernelError(
                f"a step of this size needs {size / 2**30:.1f} GiB of working memory on each "
                f"core; the compiled engine's limit is {LIMIT / 2**30:.0f} GiB: "
                "fewer slots or neurons, or engine='torch'"
            )
        return max(size, 1)

    def _heap(self, vectors: int) -> Tensor:
        users = 1 if self.job.device == "cpu" else self._groups
        try:
            return self._lent(max(vectors, 1) * self._lanes * users)
        except RuntimeError as error:
            size = self._heap_size(vectors) * users / 2**30
            raise KernelError(f"{size:.1f} GiB of working memory cannot be had") from error

    @torch_on_one_thread()
    def forward(self) -> None:
        """All steps."""
        job = self.job
        text = job.program.forward(self._lanes)
        run = self._launch(kernel(text.text, self._lanes, job.device), text.heap, (None,))
        run_in_pieces(job.n_steps, self._first(text.heap), run, job.progress)

    def _first(self, heap: int) -> int:
        numbers = heap + self.job.program.layout.size("f")
        share = self._groups / self._parts
        return first_steps(numbers, share, self.job.progress is not None)

    def _launch(
        self, made: Kernel, heap: int, more: Sequence[Tensor | None]
    ) -> Callable[[int, int], None]:
        """What runs a range of steps on as many cores as working memory allows."""
        parts = max(1, min(self._parts, LIMIT // self._heap_size(heap)))
        edges = [self._groups * part // parts for part in range(parts + 1)]
        rooms = [self._heap(heap) for _ in range(parts)]
        tables = [self._table(room, heap, more) for room in rooms]
        launches = [
            made.prepared(table, low, high - low)
            for table, (low, high) in zip(tables, pairwise(edges), strict=True)
        ]

        def run(first: int, last: int, alive: object = (rooms, tables, more)) -> None:
            with on_stream(self.job.device):
                run_all(launches, first, last)
            if self.job.device != "cpu":
                torch.cuda.synchronize(self.job.device)

        return run

    def single(self) -> tuple[Callable[[], object], np.ndarray]:
        """What runs the first step with little ado, and the table that it reads."""
        text = self.job.program.forward(self._lanes)
        room = self._heap(text.heap)
        table = self._table(room, text.heap, (None,))
        self._rooms = room, table
        made = kernel(text.text, self._lanes, self.job.device)
        return made.single(table, self._groups), table.numpy()

    @torch_on_one_thread()
    def gradient(
        self, motion: Tensor | None, state: Tensor | None
    ) -> tuple[Tensor, Tensor, Tensor, Tensor]:
        """Gradients of wanted constants (B, P), segments (S, B, Q), the first carry (B, F).

        The last is that of wanted shared constants (R,): a sum over samples, in their order.
        """
        job, lanes = self.job, self._lanes
        made = kernel(job.program.backward(lanes, *job.wanted).text, lanes, job.device)
        P, Q, R = job.program.scope.sizes(Back(*job.wanted))
        adj = torch.zeros_like(self._f)
        found_c = adj.new_zeros(self._groups, P, lanes)
        rows = (self.batch, Q) if self.turned else (self._groups, Q, lanes)
        found_s = adj.new_zeros(len(self._segments), *rows)
        sums = adj.new_zeros(self._groups, R, lanes)
        given = [None if g is None else g.contiguous().to(job.device) for g in (motion, state)]
        run = self._launch(made, self._backward_heap(), (adj, found_c, found_s, *given, sums))
        blocks = -(-job.n_steps // self._stride)
        size = max(1, self._first(self._backward_heap() - R) // (4 * self._stride))
        run_in_pieces(blocks, size, lambda first, last: run(blocks - last, blocks - first))
        found = (from_lanes(x, self.batch).cpu() for x in (found_c, adj, sums))
        constants, first_carry, each = found
        by_row = found_s if self.turned else from_lanes(found_s, self.batch)
        return constants, by_row.cpu(), first_carry, each.sum(0)

    def last(self) -> tuple[Tensor, Tensor]:
        """The carry after the last step, (B, F) and (B, K)."""
        f, k = (from_lanes(x, self.batch).cpu() for x in (self._f, self._k))
        return f, k.long()

    def forget_outputs(self) -> None:
        """Let go of the outputs, which refer back to this object through their gradient."""
        # New tensors: a slice would itself have a gradient that refers back.
        self.motion, self.state_f = (
            x.new_empty((0, *x.shape[1:])) for x in (self.motion.detach(), self.state_f.detach())
        )


def _rows(slots: Tensor) -> int:
    return int(slots.max()) + 1
