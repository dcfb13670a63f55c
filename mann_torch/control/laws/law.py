"""The interface of adaptive laws."""

from __future__ import annotations

from abc import abstractmethod
from typing import Any

from torch import Tensor

from .drive import Drive
from .keeping import Keeping


class Law(Keeping):
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

    @abstractmethod
    def forward(
        self, drive: Drive, estimate: Tensor, state: Any, mode: Any = None
    ) -> tuple[Tensor, Any]:
        """d theta/dt and d state/dt, for a theta (..., N, m)."""
