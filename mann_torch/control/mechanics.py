"""What a controller asks of a mechanical plant's equations, M a + C v + N = B tau."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Protocol, runtime_checkable

import torch
from torch import Tensor

from ..checks import instance
from ..constraints import DesignModule
from ..errors import ConfigError, ShapeError
from ..functional import as_float64, solve_small, times_column
from ..trees import leaves


@runtime_checkable
class Mechanics(Protocol):
    """Equations of motion of n coordinates: every `MechanicalPlant` has them."""

    n_joints: int

    def coefficients(self, parameters: Any) -> Any:
        """What the equations need of parameters."""

    def mass_matrix(self, q: Tensor, coefficients: Any) -> Tensor:
        """M(q) (..., n, n)."""

    def coriolis(self, q: Tensor, qd: Tensor, coefficients: Any) -> Tensor:
        """C(q, qd) (..., n, n)."""

    def load(self, q: Tensor, qd: Tensor, coefficients: Any) -> Tensor:
        """N(q, qd) (..., n)."""

    def input_matrix(self, q: Tensor, coefficients: Any) -> Tensor | None:
        """B(q) (..., n, m); None is the identity."""

    def regressor(self, q: Tensor, qd: Tensor, v: Tensor, a: Tensor) -> Tensor:
        """Y (..., n, k) with Y theta = M a + C v + N, or `NotImplementedError`."""


class NominalMechanics(DesignModule):
    """Mechanics of parameters that are thought to be right: a NamedTuple of rows (..., d).

    Raises `KindError` for other mechanics, and where parameters are not numbers, or are not the
    plant's; `ShapeError` unless there is an input for each coordinate: B is inverted.
    """

    def __init__(self, mechanics: Mechanics, parameters: Any) -> None:
        super().__init__()
        self.mechanics = instance("mechanics", mechanics, Mechanics)
        self.n_joints = mechanics.n_joints
        fields = getattr(instance("parameters", parameters, tuple), "_fields", ())
        for name, row in zip(fields, parameters, strict=True):
            as_float64(instance(name, row, Tensor), name)
        check = getattr(mechanics, "check", None)
        if check is not None:
            check(parameters)
        # Found once: which terms there are may be decided by the numbers.
        known = mechanics.coefficients(parameters)
        self._names = [f"nominal_{n}" for n in range(len(leaves(known)))]
        named = iter(self._names)
        self._form = _mapped(lambda leaf: next(named), known, Tensor)
        for name, leaf in zip(self._names, leaves(known), strict=True):
            self.register_buffer(name, leaf.detach().clone())
        B = mechanics.input_matrix(torch.zeros(self.n_joints).double(), self.coefficients())
        if B is not None and B.shape[-2] != B.shape[-1]:
            raise ShapeError(
                f"mechanics: {type(mechanics).__name__} has {B.shape[-1]} inputs for "
                f"{B.shape[-2]} coordinates; this controller wants an input for each"
            )

    def coefficients(self) -> Any:
        """Of the parameters."""
        return _mapped(lambda name: getattr(self, name), self._form, str)

    def force(self, q: Tensor, qd: Tensor, v: Tensor, a: Tensor) -> Tensor:
        """M(q) a + C(q, qd) v + N(q, qd) (..., n)."""
        known = self.coefficients()
        inertial = times_column(self.mechanics.mass_matrix(q, known), a)
        rotating = times_column(self.mechanics.coriolis(q, qd, known), v)
        return inertial + rotating + self.mechanics.load(q, qd, known)

    def mass(self, q: Tensor) -> Tensor:
        """M(q) (..., n, n)."""
        return self.mechanics.mass_matrix(q, self.coefficients())

    def input_of(self, q: Tensor, force: Tensor) -> Tensor:
        """B^-1 of forces or of columns of them, (..., n, k) -> (..., n, k)."""
        B = self.mechanics.input_matrix(q, self.coefficients())
        return force if B is None else solve_small(B, force)


def _mapped(function: Callable[[Any], Any], tree: Any, kind: type) -> Any:
    """A tree like this one, with its leaves of a kind changed; None is an empty branch."""
    if tree is None or isinstance(tree, kind):
        return None if tree is None else function(tree)
    return type(tree)(*(_mapped(function, branch, kind) for branch in tree))


def parameter_count(mechanics: Mechanics) -> int:
    """k of the regressor Y (n, k). Raises `ConfigError` for mechanics that have none."""
    at = torch.zeros(mechanics.n_joints, dtype=torch.float64)
    try:
        return mechanics.regressor(at, at, at, at).shape[-1]
    except NotImplementedError as error:
        raise ConfigError(f"mechanics: {error}") from None
