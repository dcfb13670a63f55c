"""From the library's objects to the kernel's tensors, differentiably."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import torch
from torch import Tensor

from ..control import Controller
from ..plants import ArmCoefficients
from ..signals import Sinusoid
from ..types import LoopState, MemoryMode
from .form import CONSTANTS, Form
from .job import Inputs


def _rows(value: Tensor, batch: torch.Size, event_dims: int) -> Tensor:
    """(..., *event) -> (B, *event), one row a sample."""
    event = value.shape[value.dim() - event_dims :]
    return value.expand((*batch, *event)).reshape(-1, *event)


def pack_inputs(
    form: Form,
    reference: Sinusoid,
    controller: Controller,
    coefficients: Sequence[ArmCoefficients],
    coulomb_velocity: float,
    state: LoopState,
    mode: MemoryMode | None,
    share: Tensor,
) -> Inputs:
    """Everything that gradients reach, from objects of one batch shape.

    `coefficients` has an entry a segment; `share` () is the time that the error at t = 0 counts
    for [s].
    """
    batch = state.plant.q.shape[:-1]
    constants = controller.constants()
    one = torch.ones((), dtype=torch.float64)
    scalars = [_rows(constants.get(name, one), batch, 0) for name in CONSTANTS]
    network, memory = state.controller.network, state.controller.memory
    sample = reference(torch.zeros((), dtype=torch.float64))
    squared = share * (sample.q - state.plant.q).square()
    q = _rows(state.plant.q, batch, 1)
    return Inputs(
        amplitude=_rows(reference.amplitude, batch, 1),
        frequency=_rows(reference.frequency, batch, 1),
        reference_offset=_rows(reference.offset, batch, 1),
        error_gain=_rows(constants["error_gain"], batch, 2),
        constant=torch.stack(scalars, dim=-1),
        coefficient=torch.stack(
            [_coefficient_row(c, batch, coulomb_velocity) for c in coefficients]
        ),
        q=q,
        qd=_rows(state.plant.qd, batch, 1),
        W=_rows(network.W, batch, 2),
        b_w=_rows(network.b_w, batch, 1),
        V=_rows(network.V, batch, 2),
        b_v=_rows(network.b_v, batch, 1),
        mu=None if memory is None else _rows(memory.mu, batch, 2),
        keys=_rows(memory.keys, batch, 2) if memory is not None and form.keys == "state" else None,
        squared=_rows(squared, batch, 1),
        torque=torch.zeros_like(q) if form.effort else None,
        effort=torch.zeros_like(q).repeat(1, 2) if form.effort else None,
    )


def _coefficient_row(c: ArmCoefficients, batch: torch.Size, coulomb_velocity: float) -> Tensor:
    zero = torch.zeros(2, dtype=torch.float64)
    scalars = [_rows(value, batch, 0) for value in c[:5]]
    friction = [_rows(zero if v is None else v, batch, 1) for v in (c.viscous, c.coulomb)]
    velocity = torch.full_like(scalars[0], coulomb_velocity)
    return torch.cat([torch.stack(scalars, -1), *friction, velocity.unsqueeze(-1)], dim=-1)


def pack_mode(mode: MemoryMode | None, hybrid: bool = False) -> tuple[Tensor | None, Tensor | None]:
    """Slots in use (B, S) float64, and counters (B, 3) int32; hybrid: (B, 6), for its events."""
    if mode is None:
        return None, None
    columns = [mode.attended, mode.switches, mode.reallocations]
    columns += [torch.zeros_like(mode.switches)] * 3 if hybrid else []
    counts = torch.stack(columns, dim=-1)
    active = mode.active.to(torch.float64).reshape(-1, mode.active.shape[-1])
    return active, counts.to(torch.int32).reshape(-1, len(columns))


def unpack_mode(active: Tensor | None, counts: Tensor | None, shape: Any) -> MemoryMode | None:
    """The mode again, with leading dimensions `shape`."""
    if active is None or counts is None:
        return None
    attended, switches, resets = counts[..., :3].to(torch.int64).reshape(*shape, 3).unbind(-1)
    active = active.reshape(*shape, -1)
    return MemoryMode(active > 0.5, attended, switches, resets)
