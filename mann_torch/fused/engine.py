"""Runs the kernel: on all cores or a GPU, with or without a tape, whole or in segments."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from concurrent.futures import wait
from itertools import pairwise
from typing import Any

import torch
from torch import Tensor

from ..compiled.host.kernels import on_stream
from ..compiled.march.cores import pool, torch_on_one_thread
from .form import N_EVENT
from .job import AS_THEY_ARE, CARRIED, KEPT, MOTION, PARAMETERS, Inputs, Job
from .kernels import Launch, kernel

#: Steps times samples of one launch on a core: about half a second, so that progress shows and
#: Ctrl-C is heard. With a tape, a launch is a segment.
LAUNCH_WORK = 300_000
#: Warp counts the bytes from row to row in 32 bits.
INT32 = 2**31 - 1


class Marcher:
    """Buffers and launches of one rollout. Every tensor lives on the job's device."""

    def __init__(self, job: Job, inputs: Inputs, backward: bool) -> None:
        self.job, self.backward = job, backward
        self.batch = len(inputs.q)
        self._threads = torch.get_num_threads()
        self._kernel = kernel(job.form, job.gamma, backward, job.device)
        grid = job.grid
        self.n_steps = grid.n_steps
        carried = {name: getattr(inputs, name) for name in CARRIED}
        self._carried = [name for name, value in carried.items() if value is not None]
        carried["active"] = job.active
        carried["counts"] = job.counts
        if job.form.hybrid:
            carried["event"] = inputs.q.new_zeros((self.batch, N_EVENT))
        self._start = {name: value for name, value in carried.items() if value is not None}
        step_bytes = sum(v.nelement() * v.element_size() for v in self._start.values())
        self.span = self.n_steps
        if backward:  # the tape, and the tape of its gradients
            largest = max(v.nelement() * v.element_size() for v in self._start.values())
            room = min(job.tape_memory / (2 * step_bytes), INT32 / largest - 1)
            self.span = int(min(self.n_steps, max(2, room)))
        self._ring = self.span + 1 if backward else 2
        self._tape: dict[str, Tensor] = {}
        rows = {"motion": int(grid.motion_slot.max()) + 1, "state": int(grid.state_slot.max()) + 1}
        self._in_motion = [name for name in MOTION if name in self._start]
        width = sum(self._start[name].shape[-1] for name in self._in_motion)
        self.motion = inputs.q.new_empty((rows["motion"], self.batch, width))
        self.kept = {
            name: value.new_empty((rows["state"], *value.shape))
            for name, value in self._start.items()
            if name in (*KEPT, "active", "counts")
        }
        start = {"device": inputs.q.device, "dtype": torch.int32}
        self.stop = torch.full((self.batch,), self.n_steps, **start)  # type: ignore[call-overload]
        self.cause = torch.zeros(self.batch, **start)  # type: ignore[call-overload]
        self._fixed: dict[str, Any] = {
            "ring": self._ring,
            **{name: getattr(job, name) for name in AS_THEY_ARE},
            "stop": self.stop,
            "cause": self.cause,
            **grid._asdict(),
            **{name: getattr(inputs, name) for name in PARAMETERS},
        }
        self._outputs = {"motion": self.motion}
        self._outputs |= {f"{name}_out": value for name, value in self.kept.items()}

    def _last(self) -> dict[str, Tensor]:
        """State and mode after the last step that was run."""
        return {name: tape[self._row] for name, tape in self._tape.items()}

    def _make_tape(self) -> None:
        self._tape = {name: self._rows(self._ring, value) for name, value in self._start.items()}

    @torch_on_one_thread()
    def forward(self) -> list[dict[str, Tensor]]:
        """Run all steps. Returns what each segment started from; nothing where there is one."""
        self._make_tape()
        self._put(0, self._start)
        self._keep_start()
        values = {**self._fixed, **self._tape, **self._outputs}
        launch = Launch(self._kernel, self.job.device, values)
        starts: list[dict[str, Tensor]] = []
        for first in range(0, self.n_steps, self.span):
            last = min(first + self.span, self.n_steps)
            if first > 0:
                self._put(0, self._last())
            if self.backward and self.span < self.n_steps:
                starts.append({name: tape[0].clone() for name, tape in self._tape.items()})
            self._run(launch, first, last, self.job.progress)
        self.last = {name: row.clone() for name, row in self._last().items()}
        if starts or not self.backward:
            self._tape = {}
        return starts

    def _rows(self, count: int, value: Tensor) -> Tensor:
        """Room for `count` rows of a leaf (count, B, *event).

        A CPU core walks through one sample after the other: its rows lie side by side in memory.
        The threads of a GPU walk abreast: there the samples do.
        """
        if self.job.device == "cpu":
            return value.new_empty((self.batch, count, *value.shape[1:])).transpose(0, 1)
        return value.new_empty((count, *value.shape))

    def forget_outputs(self) -> None:
        """Let go of the outputs, which refer back to this object through their gradient."""
        del self.motion, self.kept, self._outputs

    def _keep_start(self) -> None:
        """What is kept of t = 0; the kernel writes what follows a step."""
        grid, start = self.job.grid, self._start
        if int(grid.motion_slot[0]) == 0:
            self.motion[0] = torch.cat([start[name] for name in self._in_motion], dim=-1)
        if int(grid.state_slot[0]) == 0:
            for name, value in self.kept.items():
                value[0] = start[name]

    def _put(self, row: int, values: Mapping[str, Tensor]) -> None:
        for name, value in values.items():
            self._tape[name][row].copy_(value)

    def _run(
        self,
        launch: Launch,
        first: int,
        last: int,
        progress: Callable[[int], object] | None = None,
    ) -> None:
        """Steps first to last of every sample: a launch per core, or one on a GPU."""
        with on_stream(self.job.device):
            if self.job.device != "cpu":
                launch(first, last, 0, self.batch)
                if progress is not None:
                    progress(last - first)
                return
            parts = min(self._threads, self.batch)
            edges = [self.batch * part // parts for part in range(parts + 1)]
            shares = [(low, high - low) for low, high in pairwise(edges)]
            stride = last - first
            if not self.backward:
                stride = max(2, LAUNCH_WORK * parts // self.batch // 2 * 2)
            for begin in range(first, last, stride):
                end = min(begin + stride, last)
                if parts == 1:
                    launch(begin, end, *shares[0])
                else:
                    done = [pool(parts).submit(launch, begin, end, *share) for share in shares]
                    wait(done)
                    for future in done:
                        future.result()
                if progress is not None:
                    progress(end - begin)
        self._row = (last - first) % self._ring

    @torch_on_one_thread()
    def gradient(
        self, starts: list[dict[str, Tensor]], outputs: Mapping[str, Tensor | None]
    ) -> dict[str, Tensor]:
        """Gradients by name of `Inputs`, from those of the outputs by name of kernel argument.

        Unless the forward pass left its whole tape, each segment is computed again, last one first.
        Every step adds its part to a gradient in the same order as without segments: the result is
        the same to the last bit.
        """
        given = {name: value.contiguous() for name, value in outputs.items() if value is not None}
        found = {name: torch.zeros_like(self._fixed[name]) for name in PARAMETERS}
        computed = bool(self._tape)  # by the forward pass, in one piece
        if not computed:
            self._make_tape()
        tape = {name: torch.empty_like(self._tape[name]) for name in self._carried}
        back = {name: torch.zeros_like(self._start[name]) for name in self._carried}
        grid = self.job.grid
        nowhere = torch.full_like(grid.motion_slot, -1)
        silent = {"motion_slot": nowhere, "state_slot": nowhere}
        slots = dict(silent)
        if "motion" in given:
            slots["motion_slot"] = grid.motion_slot
        if any(name != "motion" for name in given):
            slots["state_slot"] = grid.state_slot
        primal = {**self._fixed, **self._tape}
        again = Launch(self._kernel, self.job.device, {**primal, **silent})
        reverse = Launch(
            self._kernel,
            self.job.device,
            {**primal, **slots, **given},
            {**found, **tape, **given},
        )
        for first in reversed(range(0, self.n_steps, self.span)):
            last = min(first + self.span, self.n_steps)
            if not computed:
                self._put(0, starts[first // self.span] if starts else self._start)
                self._run(again, first, last)
            for name, value in back.items():
                tape[name].zero_()
                tape[name][last - first].copy_(value)
            self._run(reverse, first, last)
            for name, value in back.items():
                value.copy_(tape[name][0])
        self._tape = {}  # a second backward pass computes it again
        self._add_start(back, given)
        return {**found, **back}

    def _add_start(self, back: dict[str, Tensor], given: Mapping[str, Tensor]) -> None:
        """Gradients of what was kept of t = 0."""
        grid = self.job.grid
        if "motion" in given and int(grid.motion_slot[0]) == 0:
            sizes = [back[name].shape[-1] for name in self._in_motion]
            for name, part in zip(
                self._in_motion, given["motion"][0].split(sizes, -1), strict=True
            ):
                back[name] += part
        if int(grid.state_slot[0]) == 0:
            for name in back:
                if f"{name}_out" in given:
                    back[name] += given[f"{name}_out"][0]
