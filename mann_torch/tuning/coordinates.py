"""Coordinates in which constants are moved: free numbers, 0 at the start, domains kept for good."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import torch
from torch import Tensor

from ..checks import choice, instance, several
from ..constraints import DesignModule, Finite, SymmetricPositiveDefinite
from ..errors import ConfigError, ShapeError

FORMS = ("scalar", "diagonal", "full")
#: z beyond this counts as this: a factor of 3000, short of where exp leaves the finite numbers.
BOUND = 8.0


@dataclass(frozen=True)
class _Part:
    """One constant's share of the coordinates."""

    name: str
    start: Tensor  # (*event)
    form: str  # "scalar", or "diagonal" or "full" for a matrix, "diagonal" or "free" for a row
    size: int


class Coordinates:
    """Chosen constants as functions of z (..., P), z = 0 at their present values.

    A scalar is start * exp(z): z is its relative change. A symmetric positive definite matrix
    (Lambda) is S start S', with S = exp(z/2) for ``scalar``, diag(exp(z/2)) for ``diagonal``, and
    for ``full`` lower triangular with the other P's below its diagonal: it stays symmetric positive
    definite wherever z goes. A row is start * exp(z) with one z for ``scalar``, else with one a
    number: each keeps its sign, and 0 stays 0. A row of any finite numbers is, for ``full``, start
    + z times the size of its numbers (their RMS; 1 where all are 0): weights change their signs.

    Raises `ConfigError` for no name, an unknown or repeated one, a batched constant, a constant
    that starts at the edge of its domain (0 times anything is 0), or an unknown form, `KindError`.
    """

    def __init__(
        self, module: DesignModule, names: Sequence[str], matrix_form: str = "scalar"
    ) -> None:
        instance("module", module, DesignModule)
        names = several("names", names, str)
        choice("matrix form", matrix_form, FORMS)
        if not names:
            raise ConfigError("no constant to tune; choose from " + ", ".join(module.constants()))
        if len(set(names)) < len(names):
            raise ConfigError(f"constants {', '.join(names)}: each once")
        parts = []
        for name in names:
            start = module.constant(name).detach().clone()
            matrix = isinstance(module.domain(name), SymmetricPositiveDefinite)
            if start.dim() != module.domain(name).event_dims:
                raise ConfigError(f"{name} has a batch shape {tuple(start.shape)}: tune one value")
            row = start.dim() == 1
            signed = isinstance(module.domain(name), Finite)
            free = row and signed and matrix_form == "full"
            still = (start == 0).all() if row else (start <= 0).any()
            if not matrix and not free and bool(still):
                shown = start.tolist()
                raise ConfigError(f"{name} = {shown} can't be tuned from 0: start it > 0")
            n = start.shape[-1] if matrix or row else 1
            form = matrix_form if matrix else "scalar"
            if row and matrix_form != "scalar":
                form = "free" if free else "diagonal"
            size = {"scalar": 1, "diagonal": n, "free": n, "full": n * (n + 1) // 2}[form]
            parts.append(_Part(name, start, form, size))
        self._parts = parts
        self.names = tuple(names)

    @property
    def size(self) -> int:
        """P."""
        return sum(part.size for part in self._parts)

    @property
    def labels(self) -> tuple[str, ...]:
        """A name for each coordinate."""
        found: list[str] = []
        for part in self._parts:
            if part.size == 1:
                found.append(part.name)
            else:
                n, row = part.start.shape[-1], part.start.dim() == 1
                found += [f"{part.name}[{i}]" if row else f"{part.name}[{i},{i}]" for i in range(n)]
                if part.form == "full":
                    found += [f"{part.name}[{i},{j}]" for i in range(n) for j in range(i)]
        return tuple(found)

    def values(self, z: Tensor) -> dict[str, Tensor]:
        """The constants at z (..., P), each (..., *event), differentiably.

        Raises `ShapeError`, `KindError`.
        """
        if instance("z", z, Tensor).shape[-1:] != (self.size,):
            raise ShapeError(f"z has shape {tuple(z.shape)}, not (..., {self.size})")
        values = {}
        pieces = z.clamp(-BOUND, BOUND).split([part.size for part in self._parts], dim=-1)
        for part, piece in zip(self._parts, pieces, strict=True):
            if part.start.dim() == 0:
                values[part.name] = part.start * piece.squeeze(-1).exp()
            elif part.start.dim() == 1:
                size = part.start.square().mean().sqrt()
                size = torch.where(size > 0, size, 1.0)
                free = part.form == "free"
                values[part.name] = part.start + size * piece if free else part.start * piece.exp()
            else:
                S = _factor(part, piece)
                value = S @ part.start @ S.mT
                values[part.name] = 0.5 * (value + value.mT)  # rounding, too, is symmetric
        return values

    def starts(self) -> Mapping[str, Tensor]:
        """The constants at z = 0."""
        return {part.name: part.start for part in self._parts}


def _factor(part: _Part, z: Tensor) -> Tensor:
    n = part.start.shape[-1]
    if part.form == "scalar":
        return (0.5 * z).exp().unsqueeze(-1) * torch.eye(n, dtype=z.dtype)
    diagonal = torch.diag_embed((0.5 * z[..., :n]).exp())
    if part.form == "diagonal":
        return diagonal
    row, column = torch.tril_indices(n, n, -1)
    below = torch.zeros_like(diagonal)
    below[..., row, column] = z[..., n:]
    return diagonal + below
