"""Modules of rows: tensors with leading batch dimensions that expand, select and stack together."""

from __future__ import annotations

import copy
from collections.abc import Callable, Sequence
from typing import Any, Self

import torch
from torch import Tensor, nn

from ..checks import several, sizes, wrong
from ..errors import ConfigError, ShapeError
from ..functional import Numbers, as_float64


class Rows(nn.Module):
    """A module whose registered rows are (..., *event): a row a sample.

    `hold` registers one; parts that are `Rows` themselves go along. Other attributes are shared,
    and must be equal where modules are stacked.
    """

    def __init__(self) -> None:
        super().__init__()
        self._event_dims: dict[str, int] = {}

    def hold(self, name: str, value: Numbers, event_dims: int = 1, finite: bool = True) -> Tensor:
        """Register rows (..., *event) under a name. A tensor that requires grad receives gradients.

        Raises `ConfigError` for what is not finite, unless `finite` is False, `KindError`,
        `DtypeError`, or `ShapeError` for fewer than `event_dims` dimensions.
        """
        what = f"{self._kind} {name}"
        rows = finite_rows(what, value) if finite else as_float64(value, what)
        if rows.dim() < event_dims:
            raise ShapeError(
                f"{self._kind} {name} has shape {tuple(rows.shape)}: give at least {event_dims} "
                f"dimension{'s' * (event_dims != 1)}"
            )
        self._event_dims[name] = event_dims
        self.register_buffer(name, rows)
        return rows

    def share_batch(self) -> None:
        """Write out the batch dimensions of all rows that are held. Raises `ShapeError`."""
        batch = self.batch_shape
        for name, rows in self.held().items():
            setattr(self, name, rows.expand(*batch, *self._event(name)))

    def __setattr__(self, name: str, value: Any) -> None:
        if name in vars(self).get("_event_dims", ()) and not isinstance(value, Tensor):
            raise wrong(f"{self._kind} {name}", value, "a tensor")
        super().__setattr__(name, value)

    @property
    def _kind(self) -> str:
        return type(self).__name__

    def held(self) -> dict[str, Tensor]:
        """The rows of this very module, by name."""
        return {name: getattr(self, name) for name in self._event_dims}

    def _parts(self) -> dict[str, Rows]:
        # Not `named_children`: it leaves out a part that is there twice.
        return {name: part for name, part in self._modules.items() if isinstance(part, Rows)}

    @property
    def batch_shape(self) -> torch.Size:
        """Leading batch dimensions `...` of all rows together. Raises `ShapeError`."""
        shapes = [r.shape[: r.dim() - self._event_dims[n]] for n, r in self.held().items()]
        shapes += [part.batch_shape for part in self._parts().values()]
        try:
            return torch.broadcast_shapes(*shapes)
        except RuntimeError:
            raise ShapeError(
                f"{self._kind}: batch shapes {[tuple(s) for s in shapes]} do not broadcast"
            ) from None

    def expand(self, batch_shape: Sequence[int]) -> Self:
        """The same with leading batch dimensions `batch_shape`.

        Raises `KindError`, or `ShapeError` where rows do not expand to it.
        """
        shape = sizes("batch_shape", batch_shape)

        def wide(name: str, rows: Tensor) -> Tensor:
            try:
                return rows.expand(*shape, *self._event(name))
            except RuntimeError:
                have = tuple(self.batch_shape)
                raise ShapeError(
                    f"{self._kind} of batch shape {have} does not expand to {shape}"
                ) from None

        return self._changed(wide, "expand", shape)

    def select(self, members: Sequence[int]) -> Self:
        """Some members of the first batch dimension, which every row must have.

        Raises `KindError`, or `ShapeError` where a row has none or not so many.
        """
        chosen = list(sizes("members", members, False, signed=True))

        def some(name: str, rows: Tensor) -> Tensor:
            batch = rows.dim() - self._event_dims[name]
            if batch < 1 or any(not -len(rows) <= i < len(rows) for i in chosen):
                raise ShapeError(
                    f"{self._kind} {name} has batch shape {tuple(rows.shape[:batch])}: it has no "
                    f"members {chosen}"
                )
            return rows[chosen]

        return self._changed(some, "select", chosen)

    def stack(self, others: Sequence[Any]) -> Self:
        """`others`, of this class, alike and of equal shapes, in one with a new leading dimension.

        Raises `KindError`, or `ConfigError` for none, or where they differ in more than numbers.
        """
        same = several("others", others, type(self))
        if not same:
            raise ConfigError(f"{self._kind}: give at least one to stack")
        for other in same:
            if other.form() != same[0].form():
                raise ConfigError(f"{self._kind}: only those alike but for their rows stack")
        return same[0]._changed(
            lambda name, _: torch.stack([getattr(other, name) for other in same]), "stack", same
        )

    def form(self) -> Any:
        """What modules to be stacked have in common."""
        plain = {k: v for k, v in vars(self).items() if not k.startswith("_")}
        shapes = {name: rows.shape for name, rows in self.held().items()}
        return type(self), plain, shapes, {n: part.form() for n, part in self._parts().items()}

    def _batch_dims(self) -> int:
        """How many leading batch dimensions there are."""
        own = [rows.dim() - self._event_dims[name] for name, rows in self.held().items()]
        return max((*own, *(part._batch_dims() for part in self._parts().values())), default=0)

    def _event(self, name: str) -> torch.Size:
        rows: Tensor = getattr(self, name)
        return rows.shape[rows.dim() - self._event_dims[name] :]

    def _changed(self, change: Callable[[str, Tensor], Tensor], method: str, argument: Any) -> Self:
        """A copy with other rows, its parts changed by their own `method`."""
        twin = copy.copy(self)
        buffers, modules = dict(self._buffers), dict(self._modules)
        vars(twin).update(_buffers=buffers, _modules=modules)  # past what a module checks
        for name, rows in self.held().items():
            buffers[name] = change(name, rows)
        for name, part in self._parts().items():
            given = argument
            if method == "stack":
                given = [getattr(other, name) for other in argument]
            modules[name] = getattr(part, method)(given)
        return twin


def finite_rows(what: str, value: Numbers) -> Tensor:
    """Numbers as a tensor. Raises `ConfigError` for what is not finite, `KindError`, `DtypeError`.

    A tensor that requires grad is passed through.
    """
    rows = as_float64(value, what)
    if not bool(torch.isfinite(rows).all()):
        raise ConfigError(f"{what} = {rows.tolist()}: must be finite")
    return rows


def broadcast(kind: str, **given: Numbers) -> dict[str, Tensor]:
    """Rows (..., p) that broadcast with each other, written out. Raises `ShapeError`."""
    tensors = {name: as_float64(value, f"{kind} {name}") for name, value in given.items()}
    try:
        wide = torch.broadcast_tensors(*tensors.values())
    except RuntimeError:
        shapes = ", ".join(f"{n} {tuple(t.shape)}" for n, t in tensors.items())
        raise ShapeError(f"{kind} shapes do not broadcast: {shapes}") from None
    if wide[0].dim() < 1:
        raise ShapeError(f"{kind}: give at least one of its values per output")
    return dict(zip(given, wide, strict=True))


def spread(what: str, value: Numbers, event: Sequence[int]) -> Tensor:
    """Rows (..., *event) of numbers that broadcast to them. Raises `ShapeError`."""
    given = as_float64(value, what)
    batch = given.shape[: max(0, given.dim() - len(event))]
    try:
        return given.expand(*batch, *event)
    except RuntimeError:
        wanted = ", ".join(map(str, event))
        raise ShapeError(f"{what} has shape {tuple(given.shape)}: give (..., {wanted})") from None
