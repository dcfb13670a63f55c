"""Splines through samples, given or read from a file."""

from __future__ import annotations

from pathlib import Path
from typing import Self

import torch
from torch import Tensor

from ..checks import choice, whole
from ..errors import ConfigError, ReferenceFileError, ShapeError
from ..functional import Numbers
from .pieces import check_knots
from .rows import finite_rows, spread
from .sample_file import read_samples
from .spline_solve import slopes
from .waypoints import Quintic


class Spline(Quintic):
    """The spline of `degree` 3 or 5 through `values` (..., K, p) at `times` (..., K) [s].

    Of all motions through the samples it has the least integral of acceleration^2 (3) or jerk^2
    (5); de Boor, A practical guide to splines. `ends`: "natural" leaves them free, "clamped" gives
    them `end_velocities`, and for degree 5 `end_accelerations`, that broadcast to (..., 2, p), at
    rest if not given. Before the first sample and from the last on it holds still. It has 3
    derivatives, of degree 5 it has 4.

    Slopes are computed once, when it is made: gradients reach times, values and ends through that
    one computation, so make it anew for each backward pass. Raises `ConfigError`, `ShapeError` for
    less than 2 samples (3 for natural ends of degree 5), `KindError` or `DtypeError`.
    """

    def __init__(
        self,
        times: Numbers,
        values: Numbers,
        degree: int = 3,
        ends: str = "natural",
        end_velocities: Numbers | None = None,
        end_accelerations: Numbers | None = None,
    ) -> None:
        if whole("degree", degree) not in (3, 5):
            raise ConfigError(f"degree = {degree}: choose 3 or 5")
        clamped = choice("ends", ends, ("natural", "clamped")) == "clamped"
        t, x = finite_rows("Spline times", times), finite_rows("Spline values", values)
        check_knots("Spline", t, "values", x, 3 if degree == 5 and not clamped else 2)
        given = {"end_velocities": end_velocities, "end_accelerations": end_accelerations}
        used = ["end_velocities", "end_accelerations"][: (degree - 1) // 2] if clamped else []
        for name, end in given.items():
            if end is not None and name not in used:
                raise ConfigError(f"{name}: not for {ends} ends of degree {degree}")
        fixed = None
        if clamped:
            two = (2, x.shape[-1])
            rows = [spread(f"Spline {n}", _or_rest(given[n]), two) for n in used]
            fixed = torch.stack(torch.broadcast_tensors(*rows), dim=-2)
        found = slopes(t, x, whole("degree", degree), fixed)
        velocities = found[..., 0, :]
        bends = found[..., 1, :] if degree == 5 else _bends(t, x, velocities)
        super().__init__(t, x, velocities, bends)
        self.order = 3 if degree == 3 else 4

    @classmethod
    def from_file(cls, path: str | Path, degree: int = 3, ends: str = "natural") -> Self:
        """Through the samples of a .csv file with a heading, or of an .npz file.

        Column t [s] and one column per output, in the file's order. Raises `ReferenceFileError` for
        a file that is missing, unreadable or does not fit, `KindError` or `ConfigError`.
        """
        times, values = read_samples(path)
        try:
            return cls(times, values, degree, ends)
        except ShapeError as error:
            raise ReferenceFileError(f"reference file '{path}': {error}") from None


def _or_rest(end: Numbers | None) -> Numbers:
    return 0.0 if end is None else end


def _bends(times: Tensor, values: Tensor, velocities: Tensor) -> Tensor:
    """Accelerations of a cubic spline at its samples (..., K, p): of the piece that begins there.

    At the last sample of the one that ends there.
    """
    length = torch.diff(times, dim=-1).unsqueeze(-1)
    rise = 6.0 * torch.diff(values, dim=-2) / (length * length)
    start, end = velocities[..., :-1, :], velocities[..., 1:, :]
    first = rise - (4.0 * start + 2.0 * end) / length
    last = (2.0 * start + 4.0 * end) / length - rise
    return torch.cat([first, last[..., -1:, :]], dim=-2)
