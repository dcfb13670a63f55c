"""A program's step, one a call: for streams, where a call must cost microseconds."""

from __future__ import annotations

from dataclasses import replace

import torch
from torch import Tensor

from .engine import Job, Marcher
from .layout import Moved
from .packing import from_lanes, to_lanes

#: Places in a kernel's table (`loop_text`): what a step takes, and what is carried.
_SEGMENTS, _F, _K = 8, 13, 14


class Single:
    """Steps of a job of one step, on the CPU: `after = single(before)`.

    What is carried is one flat tensor of the program's dtype: the floating numbers of all samples,
    then the integers, as the kernel has them (in lanes).
    """

    def __init__(self, job: Job, *tensors: Tensor) -> None:
        self._job = job = replace(job, device="cpu")
        layout, self._lanes = job.program.layout, job.lanes_used
        self._batch, self._real = len(job.carry_k), layout.real
        groups = -(-self._batch // self._lanes)
        self._f_shape = (groups, layout.size("f"), self._lanes)
        self._k_shape = (groups, layout.size("k"), self._lanes)
        self._n_f = torch.Size(self._f_shape).numel()
        #: Numbers of what is carried.
        self.size = self._n_f + torch.Size(self._k_shape).numel()
        #: What a step takes (B, Q): to be filled before a call, by one thread at a time.
        self.segments = tensors[1][0].detach().clone()
        self.renew(*tensors)

    def renew(self, *tensors: Tensor) -> None:
        """Other constants, in the form of the first."""
        self._marcher = Marcher(self._job, Moved(*(t.detach() for t in tensors)), False)
        self._run, self._table = self._marcher.single()

    def __call__(self, before: Tensor) -> Tensor:
        """What is carried after a step from `before`, which stays as it is."""
        after = before.clone(memory_format=torch.contiguous_format)
        table, segments = self._table, self.segments
        if not self._marcher.turned and self._lanes > 1:
            segments = to_lanes(segments, self._lanes)
        place = after.data_ptr()
        table[_SEGMENTS] = segments.data_ptr()
        table[_F] = place
        table[_K] = place + self._n_f * self._real.bytes
        self._run()
        return after

    def packed(self, f: Tensor, k: Tensor) -> Tensor:
        """One flat tensor of numbers (B, F) and integers (B, K)."""
        whole = to_lanes(k.to(self._real.whole_dtype), self._lanes).reshape(-1)
        return torch.cat([to_lanes(f, self._lanes).reshape(-1), whole.view(f.dtype)])

    def unpacked(self, carried: Tensor) -> tuple[Tensor, Tensor]:
        """The inverse of `packed`."""
        whole = carried[self._n_f :].view(self._real.whole_dtype)
        f = from_lanes(carried[: self._n_f].view(self._f_shape), self._batch)
        return f, from_lanes(whole.view(self._k_shape), self._batch).long()

    def first(self, carried: Tensor, count: int) -> Tensor:
        """The first floating numbers (B, count) of what is carried."""
        if self._batch == 1:
            return carried[:count]
        return from_lanes(carried[: self._n_f].view(self._f_shape)[:, :count], self._batch)
