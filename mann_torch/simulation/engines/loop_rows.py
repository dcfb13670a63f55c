"""A task's tensors as the compiled step takes them: a row a sample."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import torch
from torch import Tensor

from ...trees import leaves
from ..conditions import Conditions
from ..step_grid import counted_in, shares_of
from ..task import Task
from .loop_parts import Part, as_rows
from .loop_step import LoopStep


class Rows(NamedTuple):
    """A task's tensors, a row a sample."""

    constants: list[Tensor]  # each (B, *event)
    segments: list[Tensor]  # each (S, B, *event)
    carry: list[Tensor]  # each (B, *event)


def coefficient_leaves(task: Task) -> tuple[list[list[Tensor]], Any]:
    """Leaves (S of them, each a list (..., *event)) of the plant's coefficients, and their form.

    A member that is None in some segments and not in others is 0 there.
    """
    found = [task.coefficients(number) for number in range(len(task.grid.segments))]
    members = [_members(c) for c in found]
    merged: list[list[Tensor]] = [[] for _ in found]
    places: list[bool] = []
    for column in zip(*members, strict=True):
        given = next((m for m in column if m is not None), None)
        places.append(given is not None)
        if given is not None:
            for row, member in zip(merged, column, strict=True):
                row.append(torch.zeros_like(given) if member is None else member)
    return merged, _form(found[0], iter(places))


def _members(tree: Any) -> list[Tensor | None]:
    if tree is None or isinstance(tree, Tensor):
        return [tree]
    return [member for branch in tree for member in _members(branch)]


def _form(tree: Any, places: Any) -> Any:
    """The tree with a tensor where some segment has one."""
    if tree is None or isinstance(tree, Tensor):
        return torch.zeros(()) if next(places) else None
    return type(tree)(*[_form(branch, places) for branch in tree])


def task_rows(
    task: Task, step: LoopStep, parts: Sequence[Part], coefficients: Sequence[Sequence[Tensor]]
) -> Rows:
    batch, depth = task.batch, len(task.batch)
    constants = [part.rows for part in parts]
    constants.append(as_rows(task.horizon, batch, 0))
    if task.noise is not None:
        constants.append(as_rows(task.noise.std, batch, 1))
    columns = [
        torch.stack([batched(leaf, batch) for leaf in column])
        for column in zip(*coefficients, strict=True)
    ]
    state = [leaf.reshape((batch.numel(), *leaf.shape[depth:])) for leaf in leaves(task.state)]
    mode = [leaf.reshape((batch.numel(), *leaf.shape[depth:])) for leaf in leaves(task.mode)]
    carry = [*step.join(state, _first_sums(task, step), mode), *step.extra(batch.numel())]
    return Rows(constants, columns, carry)


def _first_sums(task: Task, step: LoopStep) -> list[Tensor]:
    """What is summed up, at t = 0, (B, width) each."""
    zero, count = torch.zeros((), dtype=torch.float64), task.batch.numel()
    here = Conditions(task.surroundings, task.coefficients(0))
    error, followed = task.loop.error(zero, task.state, here)
    counted = counted_in(task.grid.times[:1], task.horizon)[0]
    squared = (shares_of(task.grid.times)[0] * counted).unsqueeze(-1) * error.square()
    sums = [squared.reshape(count, -1)]
    if task.loop.model is not None:
        sums.append(followed.reshape(count, -1))
    rest = step.sum_widths[len(sums) :]
    return sums + [torch.zeros(count, width, dtype=torch.float64) for width in rest]


def batched(leaf: Tensor, batch: torch.Size) -> Tensor:
    """A coefficient (..., *event), or one without batch dimensions, as (B, *event)."""
    depth = len(batch)
    if leaf.shape[:depth] != batch:
        leaf = leaf.expand((*batch, *leaf.shape))
    return leaf.reshape((batch.numel(), *leaf.shape[depth:]))
