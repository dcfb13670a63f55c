"""The interface of a basis: features of an input that do not move."""

from __future__ import annotations

from abc import abstractmethod

from torch import Tensor

from ...constraints import DesignModule
from ...interface import Interface


class Basis(Interface, DesignModule):
    """phi (..., N) of an input z (..., I), as a `LinearNetwork` weighs them.

    Its contract: `n_inputs` I and `n_features` N say its sizes; phi is a function of z and of the
    module's own tensors alone, for any batch at once, decided by `where`, in float64. Gradients
    reach both. What is to be tuned by name is a declared constant.
    """

    n_inputs: int
    n_features: int

    @abstractmethod
    def forward(self, nn_input: Tensor) -> Tensor:
        """phi (..., N) at z (..., I)."""

    def slope(self, nn_input: Tensor, features: Tensor) -> Tensor | None:
        """d phi/dz (..., N, I), at features phi there; None: not solved for. May be approximate."""
        return None
