"""`check_law`: whether an adaptive law keeps the contract that networks and controllers rely on."""

from __future__ import annotations

from functools import partial
from typing import Any, NamedTuple

import torch
from torch import Tensor

from ..checks import instance
from ..control import Law
from ..trees import leaves, map_tensors
from .forms import called, check_held, check_tensor, difference, is_tree
from .functions import ROUNDING, SAMPLES, apart, check_function, tried_of
from .slopes import check_constants, check_slopes
from .telling import broken

#: Features and outputs that are tried; steps, and their length, on the way from t = 0.
FEATURES, OUTPUTS, STEPS, STEP = 4, 3, 5, 0.02


class Driven(NamedTuple):
    """What a law is given."""

    regressor: Tensor  # (SAMPLES, N)
    error: Tensor  # (SAMPLES, m)
    estimate: Tensor  # (SAMPLES, N, m)
    state: Any


def check_law(law: Law) -> None:
    """Raise `InterfaceError` where a law breaks a line of its contract, which it names.

    Tried on 4 features and 3 outputs, from its state at t = 0 on. Raises `KindError` for what is
    no `Law`.
    """
    instance("law", law, Law)
    check_held(law, 3)
    given = _drawn(law, OUTPUTS)
    _check_start(law, given)
    _check_forms(law, given)
    _check_still(law, given)
    _check_columns(law, given)
    moved = _moved(law, given)
    _check_forms(law, moved)
    tried = tried_of(law, 3, "forward", _rates, moved)
    check_function(tried)
    state = [f"field {i} of the state" for i, _ in enumerate(leaves(moved.state))]
    check_slopes(tried, ["the regressor", "the error", "the estimate", *state])
    check_constants(tried, 3)


def _rates(law: Law, given: Driven) -> Any:
    return law(*given)


def _drawn(law: Law, outputs: int) -> Driven:
    generator = torch.Generator().manual_seed(0)
    shape = (SAMPLES, FEATURES)
    phi = torch.randn(*shape, generator=generator, dtype=torch.float64)
    error = torch.randn(SAMPLES, outputs, generator=generator, dtype=torch.float64)
    theta = torch.randn(*shape, outputs, generator=generator, dtype=torch.float64)
    start = partial(law.initial_state, FEATURES, outputs, (SAMPLES,))
    state = called(law, 2, "initial_state for a batch", start)
    return Driven(phi, error, theta, state)


def _check_start(law: Law, given: Driven) -> None:
    """The state at t = 0: a tree, of whatever batch it is asked for, without chance."""
    if not is_tree(given.state):
        raise broken(law, 2, "initial_state gives no NamedTuple of tensors", "or None, for none")
    for batch in ((SAMPLES,), (2, 3), ()):
        start = partial(law.initial_state, FEATURES, OUTPUTS, batch)
        state = called(law, 2, f"initial_state for a batch {batch}", start)
        wanted = map_tensors(lambda x, b=batch: x[0].expand(*b, *x.shape[1:]), given.state)
        told = difference(state, wanted)
        if told is not None:
            raise broken(
                law, 2, f"initial_state for a batch {batch}: {told}", "give (..., *event) leaves"
            )
        for leaf in leaves(state):
            letters = "(..., *event)"
            check_tensor(law, 2, "the state at t = 0", leaf, leaf.shape, letters)
        if not all(map(torch.equal, leaves(state), leaves(start()))):
            raise broken(law, 2, "initial_state gives another state each time", "it is no chance")


def _check_forms(law: Law, given: Driven) -> None:
    found = called(law, 3, "forward of a batch", lambda: _rates(law, given))
    if not (isinstance(found, tuple) and len(found) == 2):
        raise broken(
            law, 3, f"forward gives a {type(found).__name__}", "return d theta/dt and d state/dt"
        )
    rate, d_state = found
    check_tensor(law, 1, "d theta/dt", rate, given.estimate.shape, "(..., N, m)")
    told = difference(d_state, given.state)
    if told is not None:
        raise broken(
            law, 2, f"d state/dt is not like the state: {told}", "return a tree of the same form"
        )
    for leaf in leaves(d_state):
        check_tensor(law, 2, "d state/dt", leaf, leaf.shape, "a tree like the state")


def _check_still(law: Law, given: Driven) -> None:
    """Without an error, at t = 0."""
    theta = given.estimate
    rate = law(given.regressor, torch.zeros_like(given.error), theta, given.state)[0]
    if law.decays:
        grows = bool(((theta * rate).sum(dim=(-2, -1)) > ROUNDING).any())
        told = "estimates grow without an error, though it says that they decay"
    else:
        grows = bool((rate != 0).any())
        told = "estimates move without an error"
    if grows:
        mend = "let the error drive them, or say `decays = True` of a law that pulls them to 0"
        raise broken(law, 4, told, mend)


def _check_columns(law: Law, given: Driven) -> None:
    """All columns together, and each alone, from the same state at t = 0."""
    together = _moved(law, given).estimate
    for j in range(OUTPUTS):
        column = slice(j, j + 1)
        own = _drawn(law, 1)._replace(
            regressor=given.regressor,
            error=given.error[..., column],
            estimate=given.estimate[..., column],
        )
        what = "forward of one output alone"
        alone = called(law, 1, what, partial(_moved, law, own)).estimate
        if apart([alone], [together[..., column]]) > ROUNDING:
            raise broken(
                law,
                1,
                f"column {j} of the estimates moves otherwise among others than alone",
                "an output's error moves its own column; what they share may depend on phi alone",
            )


def _moved(law: Law, given: Driven) -> Driven:
    """Some steps on: a state that is none of t = 0."""
    for _ in range(STEPS):
        rate, d_state = law(*given)
        given = given._replace(
            estimate=given.estimate + STEP * rate,
            state=map_tensors(lambda x, dx: x + STEP * dx, given.state, d_state),
        )
    return given
