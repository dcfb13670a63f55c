"""What a reference gives, or how it fails to."""

from __future__ import annotations

from torch import Tensor

from ..errors import MannError
from ..signals import Reference
from ..telling import explained
from ..types import ReferenceSample
from .telling import broken

#: Beside its size, how far two ways to the same number may be apart.
SAME = 1e-12


def given(reference: Reference, t: Tensor, call: str = "forward") -> tuple[Tensor, ...]:
    """Value and `order` derivatives, whatever goes wrong told as a break of the contract."""
    where = f"{call} at t of shape {tuple(t.shape)}"
    try:
        sample = getattr(reference, call)(t)
    except MannError:
        raise
    except Exception as error:
        mend = "t must broadcast with rows (..., p), and decisions are by `where`"
        raise broken(reference, 3, f"{where} raised {explained(error)}", mend) from error
    if not isinstance(sample, ReferenceSample):
        raise broken(
            reference, 3, f"{where} gave a {type(sample).__name__}", "return a ReferenceSample"
        )
    parts = [part for part in sample.parts if part is not None]
    gap = any(part is None for part in sample[: len(parts)])
    if gap or len(parts) != reference.order + 1:
        raise broken(
            reference,
            2,
            f"order = {reference.order}, {where} gave {len(parts) - 1} derivatives",
            "set `order` to the number of derivatives that `at` gives, without a gap",
        )
    return tuple(parts)


def name_of(k: int) -> str:
    """What derivative k is called."""
    return ReferenceSample._fields[k]


def same(a: Tensor, b: Tensor) -> bool:
    """Whether two ways gave the same, to rounding."""
    return bool(((a - b).abs() <= SAME * (1.0 + b.abs())).all())
