"""Every feature network keeps its contract, and `check_network` refuses what does not."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest
import torch

import mann_torch as mt
from mann_torch import control
from mann_torch.control import (
    AdaptiveLaw,
    AdaptiveNetwork,
    Constant,
    FeatureNetwork,
    FunctionBasis,
    Identity,
    Joined,
    Layers,
    LinearNetwork,
    Projection,
    RadialBasis,
)
from mann_torch.control.features import LinearWeights
from mann_torch.errors import InterfaceError
from mann_torch.testing import check_network
from mann_torch.types import Features

#: A new network is one line here.
NETWORKS_TO_CHECK: dict[str, Callable[[], FeatureNetwork]] = {
    "adaptive": lambda: AdaptiveNetwork(4, 6, 2),
    "adaptive, kappa > 0": lambda: AdaptiveNetwork(4, 6, 2, e_modification=0.1),
    "adaptive, small": lambda: AdaptiveNetwork(1, 1, 1),
    "adaptive, projected": lambda: AdaptiveNetwork(4, 6, 2, law_W=AdaptiveLaw(Projection(3.0))),
    "radial basis": lambda: LinearNetwork(RadialBasis.scattered(3, 7, 2.0), 2),
    "radial basis, small": lambda: LinearNetwork(RadialBasis([[0.0]]), 1),
    "identity": lambda: LinearNetwork(Identity(3), 2, start=0.5),
    "joined": lambda: LinearNetwork(Joined([Identity(3), Constant(3)]), 2),
    "layers": lambda: LinearNetwork(Layers.random(3, 5, 2), 2),
    "function": lambda: LinearNetwork(FunctionBasis(torch.sin, 3, 3), 2),
}


@pytest.mark.parametrize("name", NETWORKS_TO_CHECK)
def test_a_network_of_the_library_keeps_its_contract(name: str) -> None:
    check_network(NETWORKS_TO_CHECK[name]())


def test_the_list_has_every_network_there_is() -> None:
    public = [getattr(control, name) for name in control.__all__]
    kinds = {kind for kind in public if isinstance(kind, type) and issubclass(kind, FeatureNetwork)}
    assert kinds - {FeatureNetwork} == {type(make()) for make in NETWORKS_TO_CHECK.values()}


def changed(**members: Any) -> FeatureNetwork:
    """Radial basis functions that break a line."""
    network = LinearNetwork(RadialBasis.scattered(3, 7, 2.0), 2)
    network.__class__ = type("Broken", (LinearNetwork,), members)
    return network


def of(name: str, compute: Callable[..., Any]) -> FeatureNetwork:
    """With another result of a method, of the right one and its arguments."""
    right = getattr(LinearNetwork, name)
    return changed(**{name: lambda self, *given: compute(right(self, *given), *given)})


def without_size() -> FeatureNetwork:
    network = changed()
    network.n_hidden = None  # type: ignore[assignment]
    return network


def random_weights(right: Any, *given: Any) -> Any:
    return right._replace(W=right.W + torch.randn_like(right.W))


BROKEN: dict[str, tuple[Callable[[], FeatureNetwork], str]] = {
    "no size": (without_size, "line 1: n_hidden = None"),
    "weights by chance": (
        lambda: changed(
            initial_state=lambda self, batch, generator=None: random_weights(
                LinearNetwork.initial_state(self, batch)
            )
        ),
        "line 2: initial_state gives other numbers each time",
    ),
    "weights of any kind": (
        lambda: changed(check_state=lambda self, state: torch.Size((8,))),
        "line 2: check_state takes an object",
    ),
    "another batch": (
        lambda: of("check_state", lambda right, state: torch.Size((3,))),
        r"line 2: check_state gives \(3,\), not \(8,\)",
    ),
    "no batch of them": (
        lambda: changed(expand=lambda self, state, batch: state),
        "line 2: expand does not repeat the weights: W has shape",
    ),
    "features alone": (
        lambda: of("features", lambda right, *_: right.hidden),
        "line 3: features gives a Tensor; return Features",
    ),
    "features of float32": (
        lambda: of("features", lambda right, *_: Features(*(x.float() for x in right))),
        "line 3: features is torch.float32",
    ),
    "a negative norm": (
        lambda: of("magnitude", lambda right, state: -1.0 - right),
        "line 3: magnitude is negative",
    ),
    "a rate of another kind": (
        lambda: of("derivative", lambda right, *_: (right[0].W, right[1])),
        "line 3: derivative: it is a Tensor, not a LinearWeights",
    ),
    "an output that saturates": (
        lambda: of("output", lambda right, *_: torch.tanh(right)),
        "line 4: output is not linear in hidden",
    ),
    "a correction of another matrix": (
        lambda: of("correction", lambda right, *_: 2.0 * right),
        "line 4: correction is not W r with the W of output",
    ),
    "an input detached": (
        lambda: changed(
            features=lambda self, x, state: LinearNetwork.features(self, x.detach(), state)
        ),
        "line 3: the gradient of answer by the input is not what finite",
    ),
    "a slope of other sizes": (
        lambda: changed(input_slope=lambda self, features, state, first, n: state.W),
        r"line 5: input_slope has shape \(8, 7, 2\), not \(8, 2, 3\)",
    ),
    "an outer weight that is none": (
        lambda: changed(outer=("W", "b_w")),
        "line 6: outer: no field b_w",
    ),
    "an output of more than its outer weights": (
        lambda: changed(
            outer=("W",),
            initial_state=lambda self, batch, generator=None: LinearWeights(
                LinearNetwork.initial_state(self, batch).W + 0.5
            ),
            output=lambda self, hidden, state: LinearNetwork.output(self, hidden, state) + 0.1,
        ),
        "line 6: output is not linear in outer weights",
    ),
    "features of an outer weight": (
        lambda: of(
            "features",
            lambda right, x, state: right._replace(hidden=right.hidden + state.W[..., 0]),
        ),
        "line 6: features depend on outer weights",
    ),
}


@pytest.mark.parametrize("name", BROKEN)
def test_a_broken_network_is_refused_by_what_is_wrong(name: str) -> None:
    make, told = BROKEN[name]
    with pytest.raises(InterfaceError, match=rf"^\w+, contract .*(?:{told})"):
        check_network(make())


def test_what_is_no_network_is_named() -> None:
    with pytest.raises(mt.KindError, match="network = 3"):
        check_network(3)  # type: ignore[arg-type]
