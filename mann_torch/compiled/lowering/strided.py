"""Raw strides, which torch's gradients of assignments to slices speak of, as slices again."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from typing import Any, NamedTuple

from torch import Tensor

from ..graph.nodes import Graph, IndexMap, Node
from ..graph.reshapes import narrow, permute, reshape
from ..graph.views import cat, view
from .joining import slice_scatter
from .registry import lowers


class _Slice(NamedTuple):
    """Of one dimension of a tensor; `place` is the strided view's dimension along it, if any."""

    start: int
    length: int
    step: int
    place: int | None


class _Strides(NamedTuple):
    """Of a view of a tensor."""

    size: Sequence[int]
    strides: Sequence[int]
    offset: int


def _order(like: Tensor) -> list[int]:
    """Dimensions as they lie in memory, which must be all of it."""
    if like.numel() * like.element_size() != like.untyped_storage().nbytes():
        raise NotImplementedError("of a part of a tensor")
    return sorted(range(like.dim()), key=like.stride, reverse=True)


def _slices(like: Tensor, wanted: _Strides) -> list[_Slice] | None:
    """The slice of each dimension that makes up a strided view; None if there is no such."""
    left, found = wanted.offset, [_Slice(0, 1, 1, None)] * like.dim()
    places = {i for i, n in enumerate(wanted.size) if n != 1}
    for d in _order(like):
        own = like.stride(d)
        if like.shape[d] == 1:
            continue
        start, left = divmod(left, own)
        along = [i for i in places if wanted.strides[i] % own == 0 and wanted.strides[i] > 0]
        length, step, place = 1, 1, None
        if along:
            place = max(along, key=lambda i: wanted.strides[i])
            length, step = wanted.size[place], wanted.strides[place] // own
            places.remove(place)
        if start + (length - 1) * step >= like.shape[d]:
            return None
        found[d] = _Slice(start, length, step, place)
    return None if places or left else found


@lowers("as_strided.default")
def _as_strided(
    g: Graph,
    kind: str,
    x: Node,
    size: Sequence[int],
    strides: Sequence[int],
    offset: int | None = None,
    *,
    like: Tensor,
) -> Node:
    found = _slices(like, _Strides(size, strides, offset or 0))
    if found is None:
        flat = reshape(g, permute(g, x, _order(like)), (x.size,))
        return view(g, flat, size, [IndexMap(offset or 0, tuple(strides))])
    for d, part in enumerate(found):
        x = narrow(g, x, d, part.start, part.length, part.step)
    places = [part.place for part in found]
    ones = [d for d, place in enumerate(places) if place is None]
    moving = [places.index(i) for i in range(len(size)) if i in places]
    return reshape(g, permute(g, x, [*ones, *moving]), size)


@lowers("as_strided_scatter.default")
def _as_strided_scatter(
    g: Graph,
    kind: str,
    x: Node,
    new: Node,
    size: Sequence[int],
    strides: Sequence[int],
    offset: int | None = None,
    *,
    like: Tensor,
    **_: Any,
) -> Node:
    wanted = _Strides(size, strides, offset or 0)
    found = _slices(like, wanted)
    if found is None:
        return _put_one_by_one(g, x, new, like, wanted)
    order = [part.place for part in found if part.place is not None]
    small = [i for i in range(len(size)) if i not in order]
    turned = permute(g, new, [*small, *order])
    return _put(g, x, reshape(g, turned, tuple(part.length for part in found)), found, 0)


def _put(g: Graph, x: Node, new: Node, found: Sequence[_Slice], dim: int) -> Node:
    """x with `new` in the slices of the dimensions from `dim` on."""
    if dim == len(found):
        return new
    start, length, step, _ = found[dim]
    part = _put(g, narrow(g, x, dim, start, length, step), new, found, dim + 1)
    end = start + (length - 1) * step + 1
    return slice_scatter(g, x.kind, x, part, dim, start, end, step)


def _put_one_by_one(g: Graph, x: Node, new: Node, like: Tensor, wanted: _Strides) -> Node:
    """A diagonal, say: element after element as they lie in memory."""
    order = _order(like)
    turned = permute(g, x, order)
    flat, values = reshape(g, turned, (x.size,)), reshape(g, new, (new.size,))
    steps = itertools.product(*map(range, wanted.size))
    where = {
        wanted.offset + sum(i * s for i, s in zip(index, wanted.strides, strict=True)): number
        for number, index in enumerate(steps)
    }
    if len(where) != new.size:
        raise NotImplementedError("that puts several values in one place")
    parts, place = [], 0
    for at, number in sorted(where.items()):
        parts += [narrow(g, flat, 0, place, at - place), narrow(g, values, 0, number, 1)]
        place = at + 1
    parts.append(narrow(g, flat, 0, place, x.size - place))
    whole = reshape(g, cat(g, parts, 0), turned.shape)
    return permute(g, whole, [order.index(d) for d in range(len(order))])
