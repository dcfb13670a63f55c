"""Some steps of the torch engine, with a tape of their own or computed again backwards."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import torch
from torch import Tensor

from ...compiled import with_tensors
from ...plants.plant import Coefficients
from ...signals import Reference
from ...trees import leaves, map_tensors, rebuilt
from ...types import Mode
from ..task import Task
from .loop_parts import held_tensors
from .recomputed import reaches_only, recomputed
from .stepping import Carry, Stepper


class Front(NamedTuple):
    """Where the rollout is, and what came of the samples that fell."""

    carry: Carry
    stopped: Tensor  # (...,) int64, step that failed; -1
    fallen: Tensor  # (..., M) what it came to


class Trail(NamedTuple):
    """What steps leave."""

    motion: Tensor  # (T', ..., 2n) q and qd after each step
    states: Tensor | None  # (K', ..., M), where whole states are kept
    modes: Mode  # (K', ..., *event)
    torques: Tensor | None  # (T', ..., n), where effort is measured


class Found(NamedTuple):
    """What a block gives."""

    front: Front
    trail: Trail


def trail_of(motion: Sequence[Tensor], kept: Sequence[Carry], torques: Sequence[Tensor]) -> Trail:
    """Step by step -> stacked."""
    return Trail(
        motion=torch.stack(list(motion)),
        states=torch.stack([c.y for c in kept]) if kept else None,
        modes=map_tensors(lambda *x: torch.stack(x), *[c.mode for c in kept]) if kept else None,
        torques=torch.stack(list(torques)) if torques else None,
    )


def joined(trails: Sequence[Trail]) -> tuple[Tensor, Tensor, Mode, Tensor | None]:
    """Motion, states, modes and torques, one block's after the other's."""
    kept = [t for t in trails if t.states is not None]
    torques = [t.torques for t in trails if t.torques is not None]
    return (
        torch.cat([t.motion for t in trails]),
        torch.cat([t.states for t in kept if t.states is not None]),
        map_tensors(lambda *x: torch.cat(x), *[t.modes for t in kept]),
        torch.cat(torques) if torques else None,
    )


@dataclass(frozen=True)
class Block:
    """Steps `first` to `last` of a task, within a segment."""

    task: Task
    stepper: Stepper
    coefficients: Coefficients
    first: int
    last: int

    def run(self, front: Front) -> Found:
        """All of them, or until no sample is left."""
        task = self.task
        n = task.state.plant.q.shape[-1]
        sampled = set(task.state_rows)
        motion: list[Tensor] = []
        kept: list[Carry] = []
        torques: list[Tensor] = []
        times, sizes = task.grid.times, task.grid.times.diff()
        carry, stopped, fallen = front
        safe = torch.zeros_like(carry.y, requires_grad=False)
        n_alive = int(carry.alive.sum())
        for k in range(self.first, self.last):
            arguments = (task.reference, self.coefficients, task.noise_in(k))
            before = carry
            if n_alive == before.alive.numel():
                carry = self.stepper(times[k], sizes[k], before, *arguments)
            if n_alive < before.alive.numel() or not bool(carry.alive.all()):
                carry, bad = self.stepper.without_dead(times[k], sizes[k], before, safe, *arguments)
                fell = before.alive & ~carry.alive
                stopped = torch.where(fell, k, stopped)
                fallen = torch.where(fell.unsqueeze(-1), bad, fallen)
                n_alive = int(carry.alive.sum())
            motion.append(carry.y[..., : 2 * n].clone())
            if carry.torque is not None:
                torques.append(carry.torque)
            if k + 1 in sampled:
                kept.append(carry)
            if n_alive == 0:
                break
        return Found(Front(carry, stopped, fallen), trail_of(motion, kept, torques))

    def recomputed(self, front: Front) -> Found:
        """The same without a tape."""
        loop, reference = self.task.loop, self.task.reference
        own, signal = held_tensors(loop), held_tensors(reference)
        form: list[Found] = []

        def stretch(flat: Sequence[Tensor]) -> Sequence[Tensor]:
            parts = iter(flat)
            mine = {name: next(parts) for name in own}
            others = {name: next(parts) for name in signal}
            coefficients = map_tensors(lambda _: next(parts), self.coefficients)
            task = self.task
            if task.noise is not None:
                task = dataclasses.replace(task, noise=task.noise._replace(std=next(parts)))
            with with_tensors(loop, mine), with_tensors(reference, others):
                block = dataclasses.replace(self, task=task, coefficients=coefficients)
                found = block.run(rebuilt(front, list(parts)))
            form[:] = [map_tensors(Tensor.detach, found)]
            return leaves(found)

        found = recomputed(stretch, self._given(front))
        return rebuilt(form[0], found)

    def _given(self, front: Front) -> list[Tensor]:
        """All that the steps depend on: of loop, reference, plant, noise, and where they begin."""
        task = self.task
        held = [*held_tensors(task.loop).values(), *held_tensors(task.reference).values()]
        std = [] if task.noise is None else [task.noise.std]
        return [*held, *leaves(self.coefficients), *std, *leaves(front)]

    def can_be_cut(self, versions: Sequence[int], before: Front, found: Found) -> bool:
        """Whether such steps may be computed again, once they have been run.

        Not if they change a tensor of the loop in place, which would be changed again, or reach a
        tensor that loop and reference do not own up to: its gradient would be lost.
        """
        return versions == versions_of(self.task.loop, self.task.reference) and reaches_only(
            leaves(found), self._given(before)
        )


def versions_of(loop: torch.nn.Module, reference: Reference) -> list[int]:
    """How often each tensor was changed in place."""
    held = (*held_tensors(loop).values(), *held_tensors(reference).values())
    return [x._version for x in held]
