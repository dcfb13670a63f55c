"""What the laws of a network's weights keep, matrix by matrix."""

from __future__ import annotations

from typing import Any, NamedTuple

from torch import Tensor

from ...checks import instance
from ...errors import ConfigError
from ...trees import portable
from ...types import NetworkState
from ..laws import Law


@portable
class LawTrees(NamedTuple):
    """What the laws of the weights keep or decide; None where they do not."""

    W: Any
    b_w: Any
    V: Any
    b_v: Any


NO_LAWS = LawTrees(None, None, None, None)


def as_columns(state: NetworkState) -> tuple[Tensor, ...]:
    """All weights as matrices: a bias is a row of them."""
    return state.W, state.b_w.unsqueeze(-2), state.V, state.b_v.unsqueeze(-2)


def of_network(name: str, law: Any) -> Law:
    """A law whose needs a network's inner weights can meet."""
    instance(name, law, Law)
    if law.needs - {"error_norm"}:
        told = ", ".join(sorted(law.needs - {"error_norm"}))
        raise ConfigError(f"{name} needs {told}: weights within a nonlinearity have none")
    return law
