"""The interface of adaptive laws."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Sequence
from typing import Any

from torch import Tensor

from ...constraints import DesignModule
from ...interface import Interface


class Law(Interface, DesignModule):
    """d theta/dt of an estimate theta (..., N, m), column by column, of u = theta' phi.

    Its contract (`mann_torch.testing.check_law`):

    1. phi (..., N) is the regressor, s (..., m) the error that drives, a column's own. A matrix of
       estimates moves as its columns would alone.
    2. State is a tree of the law's own, NamedTuples of tensors (..., *event), or None. It starts
       the same every time, and flows: d state/dt is a tree like it.
    3. It is a function of its arguments and of declared constants alone, for any batch at once,
       decided by `where`, in float64. Gradients reach them all. Nothing is kept between calls.
    4. Without an error, and with its state at t = 0, estimates stand still, unless the law says by
       `decays` that they move towards 0.
    """

    #: Whether estimates move towards 0 where nothing drives them (sigma-modification).
    decays = False

    def initial_state(self, n_features: int, n_outputs: int, batch_shape: Sequence[int]) -> Any:
        """State at t = 0: None, or a tree of tensors (..., *event)."""
        return None

    @abstractmethod
    def forward(
        self, regressor: Tensor, error: Tensor, estimate: Tensor, state: Any
    ) -> tuple[Tensor, Any]:
        """d theta/dt and d state/dt, for phi (..., N), s (..., m) and theta (..., N, m)."""
