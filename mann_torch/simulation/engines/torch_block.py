"""Some steps of the torch engine, with a tape of their own or computed again backwards."""

from __future__ import annotations

import copy
import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import torch
from torch import Tensor

from ...compiled import frozen, with_tensors
from ...plants.plant import Coefficients
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
        """The same without a tape; for a block of a `twin`."""
        form: list[Found] = []

        def stretch(flat: Sequence[Tensor]) -> Sequence[Tensor]:
            found = self._on(front, flat)
            form[:] = [map_tensors(Tensor.detach, found)]
            return leaves(found)

        found = recomputed(stretch, self._given(front))
        return rebuilt(form[0], found)

    def _on(self, front: Front, flat: Sequence[Tensor]) -> Found:
        """The steps with these tensors in place of `_given`."""
        task, parts = self.task, iter(flat)
        mine = {name: next(parts) for name in held_tensors(task.loop)}
        others = {name: next(parts) for name in held_tensors(task.reference)}
        coefficients = map_tensors(lambda _: next(parts), self.coefficients)
        if task.noise is not None:
            noise = task.noise._replace(std=next(parts))
            task = dataclasses.replace(task, noise=noise)
        with with_tensors(task.loop, mine), with_tensors(task.reference, others):
            block = dataclasses.replace(self, task=task, coefficients=coefficients)
            return block.run(rebuilt(front, list(parts)))

    def _given(self, front: Front) -> list[Tensor]:
        """All that the steps depend on: of loop, reference, plant, noise, and where they begin."""
        task = self.task
        std = [] if task.noise is None else [task.noise.std]
        return [*_held(task), *leaves(self.coefficients), *std, *leaves(front)]

    def can_be_cut(self, front: Front) -> bool:
        """Whether such steps may be computed again: asked of a block of a `twin`, of one step.

        Not if gradients take another way than through what is put in place: a tensor that no
        module owns, one derived from a parameter before, a parameter under two names.
        """
        with torch.random.fork_rng(devices=[]):
            given = [x.view_as(x) for x in self._given(front)]
            one = dataclasses.replace(self, last=self.first + 1)
            return reaches_only(leaves(one._on(front, given)), given)


def twin(task: Task) -> Task:
    """The task on copies of its modules: what is changed in them later changes no step of it."""
    return dataclasses.replace(
        task,
        loop=frozen(task.loop),
        reference=frozen(task.reference),
        solver=copy.copy(task.solver),
    )


def _held(task: Task) -> list[Tensor]:
    """The tensors of loop and reference."""
    return [*held_tensors(task.loop).values(), *held_tensors(task.reference).values()]


class Snapshot:
    """What steps must leave as it is if they are to be computed again."""

    def __init__(self, task: Task) -> None:
        self._task = task
        self._tensors = _held(task)
        self._versions = [x._version for x in self._tensors]
        self._random = torch.get_rng_state()

    def unchanged(self) -> bool:
        """No tensor changed in place or replaced, no random number drawn."""
        now = _held(self._task)
        return (
            len(now) == len(self._tensors)
            and all(a is b for a, b in zip(now, self._tensors, strict=True))
            and self._versions == [x._version for x in now]
            and torch.equal(self._random, torch.get_rng_state())
        )
