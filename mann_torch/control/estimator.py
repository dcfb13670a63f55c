"""An estimator of a measured regression, as a controller whose input is its prediction."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import torch
from torch import Tensor

from ..checks import instance, text
from ..constraints import Finite
from ..errors import ConfigError, ShapeError
from ..functional import Numbers, as_float64, row_times
from ..trees import portable
from ..types import ControlOutput, Mode, ReferenceSample
from .controller import Controller
from .laws import AdaptiveLaw, Drive, Law, Pair
from .laws.needs import check_needs


@portable
class Estimates(NamedTuple):
    """What is estimated, and what its law keeps."""

    theta: Tensor  # (..., N, m)
    laws: Any = None


class EstimatorSignals(NamedTuple):
    """What the estimator shows."""

    missed: Tensor  # (..., m) y - Phi' theta


class Estimator(Controller):
    """u = theta' phi, the prediction of a measured y; the law is driven by s = y - u.

    `features` and `label` are the measurement's fields that hold phi (..., N) and y (..., m); the
    law has them as a `pair`, too. `start` is theta at t = 0: (N, m), or one number for all. The
    reference is not looked at. Raises `ConfigError` for a measurement without these fields or a law
    that needs what there is not, `ShapeError`, `KindError`, `DtypeError` or `DomainError`.
    """

    def __init__(
        self,
        law: Law | None = None,
        features: str = "phi",
        label: str = "y",
        start: Numbers = 0.0,
    ) -> None:
        super().__init__()
        self.law = instance("law", AdaptiveLaw() if law is None else law, Law)
        check_needs(self.law, {"error_norm", "pair"})
        self.names = text("features", features), text("label", label)
        rows = Finite().check("start", as_float64(start, "start").detach())
        if rows.dim() not in (0, 2):
            raise ShapeError(f"start of shape {tuple(rows.shape)}: give (N, m), or one number")
        self.start: Tensor
        self.register_buffer("start", rows.clone())

    @property
    def reallocates(self) -> bool:  # type: ignore[override]
        """Whether its law's state can jump."""
        return self.law.resets

    @property
    def periods(self) -> tuple[float, ...]:  # type: ignore[override]
        """Of its law."""
        return self.law.periods

    def initial_state(
        self,
        reference: ReferenceSample,
        measurement: Any,
        batch_shape: Sequence[int],
        generator: torch.Generator | None = None,
        weights: Any = None,
    ) -> tuple[Estimates, Mode]:
        """State and the law's mode at t = 0. Raises `ConfigError` or `ShapeError`."""
        phi, y = self._seen(measurement)
        sizes = (phi.shape[-1], y.shape[-1])
        if self.start.dim() and self.start.shape != sizes:
            raise ShapeError(f"start of shape {tuple(self.start.shape)}: (N, m) = {sizes} are seen")
        theta = self.start.expand(*batch_shape, *sizes)
        mode = self.law.initial_mode(*sizes, batch_shape)
        return Estimates(theta, self.law.initial_state(*sizes, batch_shape)), mode

    def forward(
        self, reference: ReferenceSample, measurement: Any, state: Estimates, mode: Mode
    ) -> ControlOutput:
        """The prediction (..., m), and what the law says."""
        drive, u = self._driven(measurement, state)
        rate, laws = self.law(drive, state.theta, state.laws, mode)
        return ControlOutput(u, Estimates(rate, laws), EstimatorSignals(drive.error[..., 0, :]))

    def jump(
        self, reference: ReferenceSample, measurement: Any, state: Estimates, mode: Mode
    ) -> tuple[Estimates, Mode]:
        """The law's decisions."""
        drive, _ = self._driven(measurement, state)
        laws, mode = self.law.jump(drive, state.theta, state.laws, mode)
        return state._replace(laws=laws), mode

    def held(self, before: Estimates, after: Estimates) -> Estimates:
        """All of it stays."""
        return before

    def _driven(self, measurement: Any, state: Estimates) -> tuple[Drive, Tensor]:
        phi, y = self._seen(measurement)
        u = row_times(phi, state.theta)
        norm = torch.linalg.vector_norm(y - u, dim=-1)
        pair = Pair(phi.unsqueeze(-1), y.unsqueeze(-2))
        return Drive.of_features(phi, y - u, norm, pair=pair), u

    def _seen(self, measurement: Any) -> tuple[Tensor, Tensor]:
        for what, name in zip(("features", "label"), self.names, strict=True):
            if not hasattr(measurement, name):
                known = ", ".join(getattr(measurement, "_fields", ())) or "none"
                raise ConfigError(f"{what} = '{name}' is no field of the measurement: {known}")
        phi, y = (getattr(measurement, name) for name in self.names)
        return phi, y
