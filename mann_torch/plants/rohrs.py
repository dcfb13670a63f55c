"""Rohrs' plant: one slow pole that is modelled, two fast ones that are not."""

from __future__ import annotations

from ..checks import flag
from .linear import LinearPlant, controllable_form


class RohrsPlant(LinearPlant):
    """y = 2 / (s + 1) 229 / (s^2 + 30 s + 229) u; without `fast_poles`, 2 / (s + 1) u.

    Its phase is -180 degrees at sqrt(259) rad/s, and u = -k y is stable for k < 7800 / 458 alone.
    Source: Rohrs, Valavani, Athans and Stein 1985, Robustness of continuous-time adaptive control
    algorithms in the presence of unmodeled dynamics. Raises `KindError`.
    """

    def __init__(self, fast_poles: bool = True) -> None:
        whole = flag("fast_poles", fast_poles)
        numerator, denominator = ([458], [1, 31, 259, 229]) if whole else ([2], [1, 1])
        super().__init__(*controllable_form(numerator, denominator))
