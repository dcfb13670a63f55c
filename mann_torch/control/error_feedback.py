"""What tracking controllers add to what they know and learn: feedback of the filtered error."""

from __future__ import annotations

from collections.abc import Sequence

from torch import Tensor

from ..checks import instance
from ..constraints import DesignModule, SymmetricPositiveDefinite
from ..functional import Numbers, times_column
from .boundary_layer import BoundaryLayer
from .integral import IntegralAction


class ErrorFeedback(DesignModule):
    """K r + robustifying term of r + K_i times the integral of r, of n outputs.

    `feedback` K is a number, n diagonal entries or an SPD matrix. Raises `ShapeError`,
    `DomainError`, `KindError` or `DtypeError`.
    """

    def __init__(
        self,
        n_joints: int,
        feedback: Numbers,
        robust: BoundaryLayer | None = None,
        integral: IntegralAction | None = None,
    ) -> None:
        super().__init__()
        self.n_joints = n_joints
        self.feedback: Tensor
        self.declare("feedback", feedback, SymmetricPositiveDefinite(), (n_joints, n_joints))
        self.robust = None if robust is None else instance("robust", robust, BoundaryLayer)
        self.integral = None if integral is None else instance("integral", integral, IntegralAction)

    def initial_state(self, batch_shape: Sequence[int]) -> Tensor | None:
        """The integral at t = 0, (..., n), None where there is none."""
        if self.integral is None:
            return None
        return self.integral.initial_state(self.n_joints, batch_shape)

    def forward(self, error: Tensor, integral: Tensor | None) -> Tensor:
        """Of r (..., n) and its integral (..., n)."""
        push = times_column(self.feedback, error)
        if self.robust is not None:
            push = push + self.robust(error)
        if self.integral is not None and integral is not None:
            push = push + self.integral(integral)
        return push

    def slope(self, error: Tensor) -> Tensor:
        """About its derivative by r, (..., n, n)."""
        slope = self.feedback.expand(*error.shape, self.n_joints)
        return slope if self.robust is None else slope + self.robust.slope(error)
