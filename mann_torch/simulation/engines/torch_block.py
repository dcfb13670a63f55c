"""Some steps of the torch engine, with a tape of their own or computed again backwards."""

from __future__ import annotations

import copy
import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import torch
from torch import Tensor

from ...compiled import frozen, with_tensors
from ...constraints import held_tensors
from ...trees import leaves, map_tensors, rebuilt
from ..task import Task
from .recomputed import reaches_only, recomputed
from .stepping import Carry, Stepper


class Front(NamedTuple):
    """Where the rollout is, and what came of the samples that fell."""

    carry: Carry
    stopped: Tensor  # (...,) int64, step that failed; -1
    fallen: Tensor  # (..., M) what it came to


class Trail(NamedTuple):
    """What steps leave."""

    motion: Tensor  # (T', ..., M_p) the plant's state after each step
    followed: Tensor | None  # (T', ..., p) what a reference model gives there
    states: Any  # (K', ..., M), where whole states are kept
    modes: Any  # (K', ..., *event)
    inputs: Tensor | None  # (T', ..., m), where effort is measured


class Found(NamedTuple):
    """What a block gives."""

    front: Front
    trail: Trail


def trail_of(
    motion: Sequence[Tensor],
    followed: Sequence[Tensor],
    kept: Sequence[Carry],
    inputs: Sequence[Tensor],
) -> Trail:
    """Step by step -> stacked."""
    return Trail(
        motion=torch.stack(list(motion)),
        followed=torch.stack(list(followed)) if followed else None,
        states=torch.stack([c.y for c in kept]) if kept else None,
        modes=map_tensors(lambda *x: torch.stack(x), *[c.mode for c in kept]) if kept else None,
        inputs=torch.stack(list(inputs)) if inputs else None,
    )


def joined(trails: Sequence[Trail]) -> Trail:
    """One block's after the other's."""
    kept = [t for t in trails if t.states is not None]
    return Trail(
        motion=torch.cat([t.motion for t in trails]),
        followed=_joined([t.followed for t in trails]),
        states=_joined([t.states for t in kept]),
        modes=map_tensors(lambda *x: torch.cat(x), *[t.modes for t in kept]),
        inputs=_joined([t.inputs for t in trails]),
    )


def _joined(rows: Sequence[Tensor | None]) -> Tensor | None:
    there = [row for row in rows if row is not None]
    return torch.cat(there) if there else None


@dataclass(frozen=True)
class Block:
    """Steps `first` to `last` of a task, within a segment."""

    task: Task
    stepper: Stepper
    coefficients: Any  # the plant's
    first: int
    last: int

    def run(self, front: Front) -> Found:
        """All of them, or until no sample is left."""
        task = self.task
        width = plant_width(task)
        packer = self.stepper.packer
        sampled = set(task.state_rows)
        motion: list[Tensor] = []
        followed: list[Tensor] = []
        kept: list[Carry] = []
        inputs: list[Tensor] = []
        times, sizes = task.grid.times, task.grid.times.diff()
        carry, stopped, fallen = front
        safe = torch.zeros_like(carry.y, requires_grad=False)
        n_alive = int(carry.alive.sum())
        for k in range(self.first, self.last):
            here, before = task.conditions(k, self.coefficients), carry
            if n_alive == before.alive.numel():
                carry = self.stepper(times[k], sizes[k], before, here)
            if n_alive < before.alive.numel() or not bool(carry.alive.all()):
                carry, bad = self.stepper.without_dead(times[k], sizes[k], before, safe, here)
                fell = before.alive & ~carry.alive
                stopped = torch.where(fell, k, stopped)
                fallen = torch.where(fell.unsqueeze(-1), bad, fallen)
                n_alive = int(carry.alive.sum())
            motion.append(carry.y[..., :width].clone())
            if task.loop.model is not None:
                at_end = task.loop.error(times[k + 1], packer.unpack(carry.y), here)
                followed.append(at_end[1])
            if carry.input is not None:
                inputs.append(carry.input)
            if k + 1 in sampled:
                kept.append(carry)
            if n_alive == 0:
                break
        return Found(Front(carry, stopped, fallen), trail_of(motion, followed, kept, inputs))

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
        others = {name: next(parts) for name in held_tensors(task.surroundings)}
        coefficients = map_tensors(lambda _: next(parts), self.coefficients)
        if task.noise is not None:
            noise = task.noise._replace(std=next(parts))
            task = dataclasses.replace(task, noise=noise)
        with with_tensors(task.loop, mine), with_tensors(task.surroundings, others):
            block = dataclasses.replace(self, task=task, coefficients=coefficients)
            return block.run(rebuilt(front, list(parts)))

    def _given(self, front: Front) -> list[Tensor]:
        """All that the steps depend on: of loop, signals, plant, noise, and where they begin."""
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


def plant_width(task: Task) -> int:
    """Numbers of the plant's state: the first of the flat one."""
    return sum(leaf.shape[-1] for leaf in leaves(task.state.plant))


def twin(task: Task) -> Task:
    """The task on copies of its modules: what is changed in them later changes no step of it."""
    return dataclasses.replace(
        task,
        loop=frozen(task.loop),
        surroundings=frozen(task.surroundings),
        solver=copy.copy(task.solver),
    )


def _held(task: Task) -> list[Tensor]:
    """The tensors of loop and signals."""
    return [*held_tensors(task.loop).values(), *held_tensors(task.surroundings).values()]


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
