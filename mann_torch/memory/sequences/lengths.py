"""Sequences of several lengths in a batch: packed, or padded with their lengths."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import torch
from torch import Tensor
from torch.nn.utils.rnn import PackedSequence, pack_padded_sequence, pad_packed_sequence

from ...errors import ConfigError, DtypeError, ShapeError

#: Lengths as they may be given.
Lengths = Sequence[int] | Tensor
_WHOLE = "must be whole numbers, one a sample"


class Padded(NamedTuple):
    """A packed sequence as steps of a batch."""

    x: Tensor  # (T, B, I)
    lengths: Tensor  # (B,) int64
    form: PackedSequence

    @classmethod
    def of(cls, packed: PackedSequence, lengths: Lengths | None) -> Padded:
        """Samples in the order in which they were packed. Raises `ConfigError` for lengths, too."""
        if lengths is not None:
            raise ConfigError("lengths: a packed sequence has its own")
        return cls(*pad_packed_sequence(packed), packed)

    def packed(self, outputs: Tensor) -> PackedSequence:
        """Outputs (T, B, M) in the form of what came in."""
        order, lengths = self.form.sorted_indices, self.lengths
        if order is not None:
            outputs, lengths = outputs.index_select(1, order), lengths[order.cpu()]
        data = pack_padded_sequence(outputs, lengths).data
        return self.form._replace(data=data)


def valid_steps(
    lengths: Lengths, n_steps: int, batch: Sequence[int], device: torch.device
) -> Tensor:
    """Which steps (T, B) lie within lengths (B,), from 1 to T; lengths may be on any device.

    Raises `DtypeError`, `ShapeError`, `ConfigError`.
    """
    if not isinstance(lengths, Tensor):
        try:
            lengths = torch.as_tensor(lengths)
        except (TypeError, ValueError, RuntimeError):
            raise DtypeError(f"lengths = {lengths!r}: {_WHOLE}") from None
        lengths = lengths if lengths.numel() else lengths.long()  # torch takes [] for floats
    if lengths.is_floating_point() or lengths.is_complex() or lengths.dtype == torch.bool:
        raise DtypeError(f"lengths are {lengths.dtype}: {_WHOLE}")
    if tuple(lengths.shape) != tuple(batch):
        raise ShapeError(
            f"lengths have shape {tuple(lengths.shape)}: one a sample of a batch of {tuple(batch)}"
        )
    if lengths.numel() and not 1 <= int(lengths.min()) <= int(lengths.max()) <= n_steps:
        raise ConfigError(f"lengths = {lengths.tolist()}: must be from 1 to {n_steps}, the steps")
    each = torch.arange(n_steps, device=device).reshape(-1, *(1 for _ in batch))
    return each < lengths.to(device)


def both(valid: Tensor | None, within: Tensor) -> Tensor:
    """Steps that both masks (T, ...) let through."""
    return within if valid is None else valid & within.to(valid.device)
