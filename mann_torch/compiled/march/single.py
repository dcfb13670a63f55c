"""A program's step, one a call: for streams, where a call must cost microseconds."""

from __future__ import annotations

from dataclasses import replace

import torch
from torch import Tensor

from ..host.kernels import kernel
from .engine import Job, Marcher
from .packing import from_lanes, to_lanes

#: Places in the table of what a call puts there.
_SEGMENTS, _F, _K = 8, 13, 14


class Single:
    """Steps of a job of one step on the CPU: `after = single(before)`.

    What is carried is one flat tensor of the program's dtype: the floating numbers of all samples,
    then the integers, as the kernel has them (in lanes).
    """

    def __init__(self, job: Job, *tensors: Tensor) -> None:
        marcher = self._marcher = Marcher(replace(job, device="cpu"), *tensors, backward=False)
        layout, text = job.program.layout, job.program.forward(job.lanes_used)
        self._lanes, self._batch = job.lanes_used, marcher.batch
        groups = -(-self._batch // self._lanes)
        self._f_shape = (groups, layout.size("f"), self._lanes)
        self._k_shape = (groups, layout.size("k"), self._lanes)
        self._n_f = torch.Size(self._f_shape).numel()
        made = kernel(text.text, self._lanes)
        self._table, self._run = marcher.single(made, text.heap)
        self._bytes = marcher.itemsize
        #: What a step takes (B, Q): to be filled before a call, by one thread at a time.
        self.segments = tensors[1][0].detach().clone()
        self._table[_SEGMENTS] = self.segments.data_ptr()

    def __call__(self, before: Tensor) -> Tensor:
        """What is carried after a step from `before`, which stays as it is."""
        after, table = before.clone(), self._table
        place = after.data_ptr()
        if self._lanes > 1:
            segments = to_lanes(self.segments, self._lanes)
            table[_SEGMENTS] = segments.data_ptr()
        table[_F] = place
        table[_K] = place + self._n_f * self._bytes
        self._run()
        return after

    def packed(self, f: Tensor, k: Tensor) -> Tensor:
        """One flat tensor of numbers (B, F) and integers (B, K)."""
        whole = to_lanes(k, self._lanes).to(self._marcher.whole_dtype).reshape(-1)
        return torch.cat([to_lanes(f, self._lanes).reshape(-1), whole.view(f.dtype)])

    def unpacked(self, carried: Tensor) -> tuple[Tensor, Tensor]:
        """The inverse of `packed`."""
        whole = carried[self._n_f :].view(self._marcher.whole_dtype)
        f = from_lanes(carried[: self._n_f].view(self._f_shape), self._batch)
        return f, from_lanes(whole.view(self._k_shape), self._batch).long()

    def first(self, carried: Tensor, count: int) -> Tensor:
        """The first floating numbers (B, count) of what is carried."""
        if self._lanes == 1:
            return carried[: self._n_f].view(self._batch, -1)[:, :count]
        return from_lanes(carried[: self._n_f].view(self._f_shape)[:, :count], self._batch)
