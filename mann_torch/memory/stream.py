"""A cell one step a call, in microseconds: for control loops and policies that act."""

from __future__ import annotations

from collections.abc import Sequence

import torch
from torch import Tensor

from ..checks import instance, sizes
from ..errors import ConfigError, DtypeError, ShapeError
from .cell import MemoryCell
from .cell_state import CellState


class MemoryStream:
    """`output, state = stream(x, state)`: a `MemoryCell` step by step, compiled, without gradients.

    x is (*batch_shape, I), output (*batch_shape, N or output_size), the numbers those of the cell.
    The state is one flat tensor, opaque, to be kept, copied and saved as it is; a call changes
    neither. `initial_state` gives the first, `packed` and `unpacked` turn a `CellState` into one
    and back. Parameters that were changed since, by an optimizer or `load_state_dict`, are taken
    up; after `initialize` or a change of structure make a new stream.

    Raises `KindError` for what is no cell, `ConfigError` or `KernelError`, with the reason, where
    the cell can't be compiled: call the cell itself then.

    >>> cell = MemoryCell(3, 8)
    >>> stream = MemoryStream(cell)
    >>> state = stream.initial_state()
    >>> output, state = stream(torch.zeros(3), state)
    >>> output.shape
    torch.Size([8])
    """

    def __init__(self, cell: MemoryCell, batch_shape: Sequence[int] | int = ()) -> None:
        from ..compiled import UntraceableError
        from .streaming import Streamed

        self.cell = instance("cell", cell, MemoryCell)
        self.batch_shape = sizes("batch_shape", batch_shape)
        try:
            self._streamed = Streamed(cell, torch.Size(self.batch_shape))
        except UntraceableError as error:
            raise ConfigError(f"a stream needs the compiled engine: {error}") from None
        self._shape = torch.Size((*self.batch_shape, cell.input_size))
        self._size = self._streamed.size
        self._dtype = cell.dtype

    def __call__(
        self, x: Tensor, state: Tensor, dt: Tensor | float | None = None
    ) -> tuple[Tensor, Tensor]:
        """Output (*batch_shape, N or output_size) and the next state. `dt` as the cell's.

        Raises `KindError`, `ShapeError`, `DtypeError`.
        """
        if x.__class__ is not Tensor or x.shape != self._shape or x.dtype != self._dtype:
            self._refuse("x", x, self._shape)
        if state.__class__ is not Tensor or state.numel() != self._size:
            self._refuse("state", state, torch.Size((self._size,)))
        return self._streamed(x, state, dt)

    def _refuse(self, name: str, given: object, shape: torch.Size) -> None:
        """Say what is wrong with a tensor, if anything is (a subclass of Tensor may do)."""
        found = instance(name, given, Tensor)
        if found.shape != shape:
            raise ShapeError(f"{name} has shape {tuple(found.shape)}, not {tuple(shape)}")
        if found.dtype != self._dtype:
            raise DtypeError(f"{name} is {found.dtype}, this stream takes {self._dtype}")

    def initial_state(self) -> Tensor:
        """The state before the first step."""
        return self.packed(self.cell.initial_state(self.batch_shape))

    def packed(self, state: CellState) -> Tensor:
        """A cell's state as a stream's. Raises `KindError`, `ShapeError`, `DtypeError`."""
        found = self.cell.check_state(state)
        if found != tuple(self.batch_shape):
            raise ShapeError(
                f"state has batch shape {found}, this stream {tuple(self.batch_shape)}"
            )
        return self._streamed.packed(state)

    def unpacked(self, state: Tensor) -> CellState:
        """A stream's state as a cell's. Raises `KindError`, `ShapeError`, `DtypeError`."""
        self._refuse("state", state, torch.Size((self._size,)))
        return self._streamed.unpacked(state)
