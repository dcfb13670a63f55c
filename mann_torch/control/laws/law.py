"""The interface of adaptive laws."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Sequence
from typing import Any

from torch import Tensor

from ...constraints import DesignModule
from ...interface import Interface
from .drive import Drive


class Law(Interface, DesignModule):
    """d theta/dt of an estimate theta (..., N, m) in u = Phi' theta.

    Its contract (`mann_torch.testing.check_law`):

    1. A matrix of estimates moves as its columns would alone.
    2. State and mode are trees of the law's own, NamedTuples of tensors (..., *event), or None.
       They start the same every time. The state flows: d state/dt is a tree like it. The mode
       only changes by `jump`; the state jumps only if the law `resets`.
    3. It is a function of its arguments and of declared constants alone, for any batch at once,
       decided by `where`, in float64. Gradients reach them all. Nothing is kept between calls.
    4. Without an error, and with state and mode at t = 0, estimates stand still, unless the law
       says by `decays` that they move towards 0, or by `drives` that it has an error of its own.
    5. `needs` names what it reads of a `Drive` beyond regressor and error: "error_norm", "excess",
       "pair". A controller that has no such thing refuses the law. Regressors (..., N, r) may have
       any r, unless it says `rows`.
    6. `jump` twice at one instant is `jump` once. What it does from time to time it times itself
       (`control.timing`), and says `periods`.
    """

    @property
    def decays(self) -> bool:
        """Whether estimates move towards 0 where nothing drives them (sigma-modification)."""
        return False

    @property
    def drives(self) -> bool:
        """Whether an error of its own moves estimates, too: that of a pair, or of stored data."""
        return "pair" in self.needs

    @property
    def needs(self) -> frozenset[str]:
        """Fields of `Drive` that it reads and not every controller has."""
        return frozenset()

    @property
    def rows(self) -> int | None:
        """r of the regressors (..., N, r) that it takes; None: any."""
        return None

    @property
    def periods(self) -> tuple[float, ...]:
        """Periods [s] at whose multiples its `jump` samples."""
        return ()

    @property
    def resets(self) -> bool:
        """Whether `jump` can change its state."""
        return False

    def initial_state(self, n_features: int, n_outputs: int, batch_shape: Sequence[int]) -> Any:
        """State at t = 0: None, or a tree of tensors (..., *event)."""
        return None

    def initial_mode(self, n_features: int, n_outputs: int, batch_shape: Sequence[int]) -> Any:
        """What only jumps change, at t = 0: None, or a tree of tensors (..., *event)."""
        return None

    @abstractmethod
    def forward(
        self, drive: Drive, estimate: Tensor, state: Any, mode: Any = None
    ) -> tuple[Tensor, Any]:
        """d theta/dt and d state/dt, for a theta (..., N, m)."""

    def jump(self, drive: Drive, estimate: Tensor, state: Any, mode: Any) -> tuple[Any, Any]:
        """State and mode after the decisions of one instant."""
        return state, mode
