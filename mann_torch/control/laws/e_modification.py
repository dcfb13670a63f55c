"""e-modification."""

from __future__ import annotations

from torch import Tensor

from ...functional import Numbers, per_matrix
from .drive import Drive
from .part import Leak


class EModification(Leak):
    """- Gamma kappa |e| theta: a leak in proportion to the tracking error.

    `e_modification` is kappa. Narendra and Annaswamy 1987, A new adaptive law for robust adaptation
    without persistent excitation. Raises `DomainError`, `KindError` or `DtypeError`.
    """

    def __init__(self, e_modification: Numbers = 0.0) -> None:
        super().__init__()
        self.e_modification: Tensor
        self.declare_rows("e_modification", e_modification)

    @property
    def decays(self) -> bool:
        """False: without an error it does nothing."""
        return False

    @property
    def needs(self) -> frozenset[str]:
        """The norm of the tracking error."""
        return frozenset({"error_norm"})

    def forward(self, drive: Drive, estimate: Tensor) -> Tensor:
        """kappa |e| (..., 1 or N, 1)."""
        if not self._domains["e_modification"].event_dims:
            return per_matrix(self.e_modification * drive.error_norm)
        return self.per_estimate("e_modification") * per_matrix(drive.error_norm)
