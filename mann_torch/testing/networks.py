"""`check_network`: whether a feature network keeps the contract that controllers build on."""

from __future__ import annotations

from functools import partial
from typing import Any, NamedTuple

import torch
from torch import Tensor

from ..checks import instance
from ..control import Drive, FeatureNetwork
from ..trees import difference, leaves, map_tensors
from ..types import Features
from .forms import called, check_held, check_tensor, is_tree
from .functions import ROUNDING, SAMPLES, apart, check_function, tried_of
from .random_starts import check_start, check_weights
from .slopes import check_constants, check_slopes
from .telling import broken

#: Steps, and their length, on the way from t = 0.
STEPS, STEP = 4, 0.02


class Fed(NamedTuple):
    """What a network is given."""

    nn_input: Tensor  # (SAMPLES, I)
    feedback: Tensor  # (SAMPLES, m)
    error_norm: Tensor  # (SAMPLES,)
    extra: Tensor  # (SAMPLES, N) what a memory adds to the features
    state: Any
    laws: Any
    mode: Any


class Answer(NamedTuple):
    """All that it gives."""

    features: Tensor
    output: Tensor
    correction: Tensor
    magnitude: Tensor
    derivative: Any
    of_laws: Any


def check_network(network: FeatureNetwork) -> None:
    """Raise `InterfaceError` where a feature network breaks a line of its contract, which it names.

    Raises `KindError` for what is no `FeatureNetwork`.
    """
    instance("network", network, FeatureNetwork)
    check_held(network, 3)
    for name in ("n_inputs", "n_hidden", "n_outputs"):
        value = getattr(network, name, None)
        if isinstance(value, bool) or not isinstance(value, int) or value < 1:
            raise broken(network, 1, f"{name} = {value!r}", f"set `{name}` to a whole number >= 1")
    check_start(network, 2, "initial_state", network.initial_state)
    given = _drawn(network)
    _check_weights(network, given.state)
    _check_forms(network, given)
    for _ in range(STEPS):
        found = _answers(network, given)
        given = given._replace(
            state=_stepped(given.state, found.derivative), laws=_stepped(given.laws, found.of_laws)
        )
    _check_forms(network, given)
    _check_pairing(network, given)
    tried = tried_of(network, 3, "answer", _answers, given)
    check_function(tried)
    weights = [f"field {i} of the weights" for i, _ in enumerate(leaves(given.state))]
    weights += [f"field {i} of what laws keep" for i, _ in enumerate(leaves(given.laws))]
    names = ["the input", "the feedback", "|e|", "what is added to the features", *weights]
    check_slopes(tried, names)
    check_constants(tried, 3)
    _check_slope(network, given)
    _check_outer(network, given)


def _stepped(tree: Any, rates: Any) -> Any:
    return map_tensors(lambda x, dx: x + STEP * dx, tree, rates)


def _answers(network: FeatureNetwork, given: Fed) -> Answer:
    x, r, norm, extra, state, *_ = given
    features = network.features(x, state)
    correction = network.correction(r, state)
    drive = Drive.of_features(features.hidden, r, norm)
    rates = network.derivative(x, features, drive, correction, state, given.laws, given.mode)
    return Answer(
        features.hidden,
        network.output(features.hidden + extra, state),
        correction,
        network.magnitude(state),
        *rates,
    )


def _drawn(network: FeatureNetwork) -> Fed:
    generator = torch.Generator().manual_seed(0)

    def draw(*shape: int) -> Tensor:
        return torch.randn(SAMPLES, *shape, generator=generator, dtype=torch.float64)

    return Fed(
        draw(network.n_inputs),
        draw(network.n_outputs),
        draw().abs(),
        0.1 * draw(network.n_hidden),
        network.initial_state((SAMPLES,), generator),
        *network.initial_laws((SAMPLES,)),
    )


def _check_weights(network: FeatureNetwork, state: Any) -> None:
    """`check_state` and `expand` of them."""
    check_weights(network, 2, "check_state", state, network.check_state)
    single = network.initial_state(())
    batch = called(network, 2, "expand", partial(network.expand, single, (2, SAMPLES)))
    wanted = map_tensors(lambda x: x.expand(2, SAMPLES, *x.shape), single)
    told = difference(batch, wanted)
    if told is not None or not all(map(torch.equal, leaves(batch), leaves(wanted))):
        raise broken(
            network, 2, f"expand does not repeat the weights: {told or 'numbers'}", "(..., *event)"
        )


def _check_forms(network: FeatureNetwork, given: Fed) -> None:
    features = called(network, 3, "features", lambda: network.features(given[0], given.state))
    if not isinstance(features, Features):
        raise broken(network, 3, f"features gives a {type(features).__name__}", "return Features")
    found = called(network, 3, "what it gives of a batch", lambda: _answers(network, given))
    N, m = network.n_hidden, network.n_outputs
    shapes = {"features": (N,), "output": (m,), "correction": (N,), "magnitude": ()}
    for name, shape in shapes.items():
        letters = f"(..., {', '.join(map(str, shape))})"
        check_tensor(network, 3, name, getattr(found, name), (SAMPLES, *shape), letters)
    if bool((found.magnitude < 0).any()):
        raise broken(network, 3, "magnitude is negative", "it is a sum of norms")
    told = difference(found.derivative, given.state)
    if told is not None or not is_tree(found.derivative):
        raise broken(network, 3, f"derivative: {told}", "return a tree like the weights")
    told = difference(found.of_laws, given.laws)
    if told is not None:
        raise broken(network, 3, f"derivative of laws: {told}", "return a tree like theirs")


def _check_pairing(network: FeatureNetwork, given: Fed) -> None:
    """W of the output is W of the correction: a memory is written with what it is read by."""
    state, hidden = given.state, given.extra
    without = network.output(torch.zeros_like(hidden), state)
    linear = network.output(hidden, state) - without
    twice = network.output(2.0 * hidden, state) - without
    if apart([twice], [2.0 * linear]) > ROUNDING:
        raise broken(network, 4, "output is not linear in hidden", "nonlinearities belong in sigma")
    one = (linear * given.feedback).sum(dim=-1)
    other = (hidden * network.correction(given.feedback, state)).sum(dim=-1)
    if apart([one], [other]) > ROUNDING:
        raise broken(
            network, 4, "correction is not W r with the W of output", "r' W' hidden = hidden' W r"
        )


def _check_slope(network: FeatureNetwork, given: Fed) -> None:
    features, n = network.features(given.nn_input, given.state), network.n_inputs
    call = partial(network.input_slope, features, given.state, 0, n)
    found = called(network, 5, "input_slope", call)
    if found is not None:
        shape = (SAMPLES, network.n_outputs, n)
        check_tensor(network, 5, "input_slope", found, shape, "(..., m, n)")


def _check_outer(network: FeatureNetwork, given: Fed) -> None:
    """What is called W is W."""
    x, state, hidden = given.nn_input, given.state, given.extra
    lacking = [name for name in network.outer if not hasattr(state, name)]
    if lacking:
        raise broken(network, 6, f"outer: no field {lacking[0]}", "name fields of the weights")
    if not network.outer:
        return
    twice = state._replace(**{name: 2.0 * getattr(state, name) for name in network.outer})
    if apart([network.output(hidden, twice)], [2.0 * network.output(hidden, state)]) > ROUNDING:
        raise broken(network, 6, "output is not linear in outer weights", "name all of W, not more")
    features = network.features(x, twice).hidden
    if not torch.equal(features, network.features(x, state).hidden):
        raise broken(network, 6, "features depend on outer weights", "name all of W, not more")
