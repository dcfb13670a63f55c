"""A cell one step a call, in microseconds: for control loops and policies that act."""

from __future__ import annotations

from collections.abc import Sequence

import torch
from torch import Tensor

from ...checks import instance, sizes
from ...errors import ConfigError, DtypeError, ShapeError
from ...functional import pick
from ...trees import map_tensors
from ..cells.cell import MemoryCell
from ..cells.cell_state import CellState
from ..checks import exactly

STATE = "a stream's Tensor: initial_state() gives the first, packed(...) makes one of a CellState"


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
        from ...compiled import UntraceableError
        from ..engine.streaming import Streamed

        self.cell = instance("cell", cell, MemoryCell)
        self.batch_shape = sizes("batch_shape", batch_shape)
        if 0 in self.batch_shape:
            raise ConfigError(f"batch_shape = {self.batch_shape}: a stream needs a sample")
        try:
            with exactly(cell.slots.device):
                self._streamed = Streamed(cell, torch.Size(self.batch_shape))
        except UntraceableError as error:
            raise ConfigError(f"a stream needs the compiled engine: {error}") from None
        self._shape = torch.Size((*self.batch_shape, cell.input_size))
        self._flat = torch.Size((self._streamed.size,))
        self._dtype = cell.dtype

    def __call__(
        self, x: Tensor, state: Tensor, dt: Tensor | float | None = None
    ) -> tuple[Tensor, Tensor]:
        """Output (*batch_shape, N or output_size) and the next state. `dt` as the cell's.

        Raises `KindError`, `ShapeError`, `DtypeError`.
        """
        if x.__class__ is not Tensor or x.shape != self._shape or x.dtype != self._dtype:
            self._refuse("x", x, self._shape)
        if state.__class__ is not Tensor or state.shape != self._flat or state.dtype != self._dtype:
            self._refuse("state", state, self._flat)
        return self._streamed(x, state, dt)

    def _refuse(self, name: str, given: object, shape: torch.Size) -> None:
        """Say what is wrong with a tensor, if anything is (a subclass of Tensor may do)."""
        found = instance(name, given, Tensor, STATE if name == "state" else "")
        if found.shape != shape:
            raise ShapeError(f"{name} has shape {tuple(found.shape)}, not {tuple(shape)}")
        if found.dtype != self._dtype:
            raise DtypeError(
                f"{name} is {found.dtype}, this stream takes {self._dtype}: convert {name}, or the "
                "cell before a stream is made of it, with .to(...)"
            )

    def initial_state(self) -> Tensor:
        """The state before the first step."""
        return self.packed(self.cell.initial_state(self.batch_shape))

    def begun(self, state: Tensor, reset: Tensor) -> Tensor:
        """The state with samples that begin anew where `reset` (*batch_shape) bool says so.

        Raises `KindError`, `ShapeError`, `DtypeError`.
        """
        mask = instance("reset", reset, Tensor)
        if mask.dtype != torch.bool:
            raise DtypeError(f"reset is {mask.dtype}: it is a mask of bool")
        if mask.shape != torch.Size(self.batch_shape):
            raise ShapeError(f"reset has shape {tuple(mask.shape)}, not {tuple(self.batch_shape)}")
        with torch.no_grad():
            fresh, held = self.cell.initial_state(self.batch_shape), self.unpacked(state)
            return self.packed(map_tensors(lambda new, old: pick(mask, new, old), fresh, held))

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
        self._refuse("state", state, self._flat)
        return self._streamed.unpacked(state)
