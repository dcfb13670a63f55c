"""Nested NamedTuples of tensors: map over their leaves, pack them into one flat tensor."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from typing import Any, Generic, TypeVar

import torch
from torch import Tensor
from torch.utils import _pytree as pytree

Tree = TypeVar("Tree")
Kind = TypeVar("Kind", bound=type)


def portable(kind: Kind) -> Kind:
    """Let a NamedTuple of tensors be loaded with `weights_only=True` and saved by `torch.export`.

    A class decorator.
    """
    torch.serialization.add_safe_globals([kind])
    # The public registration is for dataclasses only.
    pytree._register_namedtuple(kind, serialized_type_name=f"{kind.__module__}.{kind.__qualname__}")
    return kind


def leaves(tree: Any) -> list[Tensor]:
    """The tensors of a tree in field order; None is an empty branch."""
    if isinstance(tree, Tensor):
        return [tree]
    found: list[Tensor] = []
    if tree is not None:
        for branch in tree:
            found += leaves(branch)
    return found


def leaf_names(tree: Any) -> tuple[str, ...]:
    """The field name of each of `leaves(tree)`; a tree that is one tensor has no field: "value"."""
    if isinstance(tree, Tensor):
        return ("value",)
    names: tuple[str, ...] = ()
    for name, branch in zip(tree._fields, tree, strict=True):
        if isinstance(branch, Tensor):
            names += (name,)
        elif branch is not None:
            names += leaf_names(branch)
    return names


def leaf_paths(tree: Any, above: str = "") -> tuple[str, ...]:
    """The dotted names of fields that lead to each of `leaves(tree)`."""
    if isinstance(tree, Tensor):
        return (above or "value",)
    found: tuple[str, ...] = ()
    if tree is not None:
        for name, branch in zip(tree._fields, tree, strict=True):
            found += leaf_paths(branch, f"{above}.{name}" if above else name)
    return found


def map_tensors(function: Callable[..., Tensor], tree: Tree, *others: Tree) -> Tree:
    """Apply `function` to each tensor of `tree` (and its partners in `others`)."""
    if tree is None:
        return tree
    if isinstance(tree, Tensor):
        return function(tree, *others)  # type: ignore[return-value]
    branches = [map_tensors(function, *parts) for parts in zip(tree, *others, strict=True)]  # type: ignore[call-overload]
    return type(tree)(*branches)


def _builder(template: Any, slots: Iterator[int]) -> Callable[[Sequence[Tensor]], Any]:
    """A function that puts a flat list of tensors back into the template's form."""
    if template is None:
        return lambda parts: None
    if isinstance(template, Tensor):
        slot = next(slots)
        return lambda parts: parts[slot]
    branches = [_builder(branch, slots) for branch in template]
    kind = type(template)
    return lambda parts: kind(*[branch(parts) for branch in branches])


def rebuilt(template: Tree, parts: Sequence[Tensor]) -> Tree:
    """The template's form with other tensors, in the order of `leaves`."""
    tree: Tree = _builder(template, iter(range(len(parts))))(parts)
    return tree


def structure(tree: Any) -> Any:
    """Which members of a tree there are, and of what kinds."""
    if tree is None or isinstance(tree, Tensor):
        return tree is not None
    return (type(tree).__qualname__, *(structure(branch) for branch in tree))


def difference(found: Any, wanted: Any, at: str = "") -> str | None:
    """What is another in `found` than in the tree `wanted`: kinds, shapes, dtypes; None: nothing.

    >>> difference(torch.zeros(2), torch.zeros(3))
    'it has shape (2,), not (3,)'
    """
    name = at or "it"
    if isinstance(wanted, Tensor):
        if not isinstance(found, Tensor):
            return f"{name} is a {type(found).__name__}, not a tensor"
        if found.shape != wanted.shape:
            return f"{name} has shape {tuple(found.shape)}, not {tuple(wanted.shape)}"
        return None if found.dtype == wanted.dtype else f"{name} is {found.dtype}"
    if type(found) is not type(wanted):
        return f"{name} is a {type(found).__name__}, not a {type(wanted).__name__}"
    if wanted is None:
        return None
    for field, mine, other in zip(wanted._fields, found, wanted, strict=True):
        told = difference(mine, other, f"{at}.{field}".removeprefix("."))
        if told is not None:
            return told
    return None


class Packer(Generic[Tree]):
    """Turns a tree of tensors (*batch, *event) into one (*batch, M) and back.

    `template` fixes the event shapes; the batch shape may differ from call to call.
    """

    def __init__(self, template: Tree, batch_dims: int) -> None:
        shapes = [tuple(leaf.shape[batch_dims:]) for leaf in leaves(template)]
        self._build = _builder(template, iter(range(len(shapes))))
        self._sizes = [math.prod(shape) for shape in shapes]
        self._matrices = [(i, shape) for i, shape in enumerate(shapes) if len(shape) != 1]

    def pack(self, tree: Tree) -> Tensor:
        """(*batch, M), leaves one after the other."""
        parts = leaves(tree)
        for i, shape in self._matrices:
            part = parts[i]
            parts[i] = part.reshape(*part.shape[: part.dim() - len(shape)], self._sizes[i])
        return torch.cat(parts, dim=-1)

    def split(self, flat: Tensor) -> tuple[Tensor, ...]:
        """The leaves, each still flat (*batch, size)."""
        return flat.split(self._sizes, dim=-1)

    def unpack(self, flat: Tensor) -> Tree:
        """The tree again, as views of `flat` where possible."""
        parts = list(self.split(flat))
        for i, shape in self._matrices:
            parts[i] = parts[i].unflatten(-1, shape) if shape else parts[i].squeeze(-1)
        tree: Tree = self._build(parts)
        return tree
