"""`check_law`: whether an adaptive law keeps the contract that networks and controllers rely on."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

import torch
from torch import Tensor

from ..checks import instance
from ..control import Drive, Law, Pair
from ..trees import difference, leaves, map_tensors
from .forms import called, check_held, check_tensor, is_tree
from .functions import ROUNDING, SAMPLES, apart, check_function, tried_of
from .slopes import check_constants, check_slopes
from .telling import broken

#: Features and outputs that are tried; steps, and their length, on the way from t = 0.
FEATURES, OUTPUTS, STEPS, STEP = 4, 3, 5, 0.02


class Driven(NamedTuple):
    """What a law is given."""

    drive: Drive
    estimate: Tensor  # (SAMPLES, N, m)
    state: Any
    mode: Any


def check_law(law: Law) -> None:
    """Raise `InterfaceError` where a law breaks a line of its contract, which it names.

    Tried on 4 features and 3 outputs, from its state at t = 0 on, and on a regressor of 2 columns
    for one output, or of those that it says. Raises `KindError` for what is no `Law`.
    """
    instance("law", law, Law)
    check_held(law, 3)
    for outputs, rows in ((OUTPUTS, law.rows or 1), (1, law.rows or 2)):
        _check_driven(law, _drawn(law, outputs, rows), outputs)


def _check_driven(law: Law, given: Driven, outputs: int) -> None:
    for kind, tree, start in (("state", given.state, law.initial_state),
                              ("mode", given.mode, law.initial_mode)):  # fmt: skip
        _check_start(law, kind, tree, partial(start, FEATURES, outputs))
    _check_forms(law, given)
    _check_jump(law, given)
    _check_still(law, given)
    if outputs > 1:
        _check_columns(law, given)
    moved = _moved(law, given)
    _check_forms(law, moved)
    _check_jump(law, moved)
    tried = tried_of(law, 3, "forward", _rates, moved)
    check_function(tried)
    names = [f"field {i} of what drives, the estimate and what it keeps" for i in range(99)]
    names = ["the regressor", "the error", *names][: len(tried.arguments)]
    check_slopes(tried, names)
    check_constants(tried, 3)


def _rates(law: Law, given: Driven) -> Any:
    return law(*given)


def _drawn(law: Law, outputs: int, r: int) -> Driven:
    """An error and all else that the law needs, of which each column has its own."""
    generator = torch.Generator().manual_seed(0)

    def draw(*shape: int) -> Tensor:
        """For all outputs, of which the first are taken."""
        wide = (*shape[:-1], OUTPUTS) if shape else ()
        rows = torch.randn(SAMPLES, *wide, generator=generator, dtype=torch.float64)
        return rows[..., : shape[-1]] if shape else rows

    def features() -> Tensor:
        return torch.randn(SAMPLES, FEATURES, r, generator=generator, dtype=torch.float64)

    phi, error, theta = features(), draw(r, outputs), draw(FEATURES, outputs)
    norm, excess, pair = draw().abs(), draw(outputs), Pair(features(), draw(r, outputs))
    drive = Drive(
        phi,
        error,
        norm,
        excess if "excess" in law.needs else None,
        pair if "pair" in law.needs else None,
    )
    sizes = (FEATURES, outputs, (SAMPLES,))
    state = called(law, 2, "initial_state for a batch", partial(law.initial_state, *sizes))
    mode = called(law, 2, "initial_mode for a batch", partial(law.initial_mode, *sizes))
    return Driven(drive, theta, state, mode)


def _check_start(law: Law, kind: str, given: Any, make: Callable[..., Any]) -> None:
    """What there is at t = 0: a tree, of whatever batch it is asked for, without chance."""
    name = f"initial_{kind}"
    if not is_tree(given):
        raise broken(law, 2, f"{name} gives no NamedTuple of tensors", "or None, for none")
    for batch in ((SAMPLES,), (2, 3), ()):
        start = partial(make, batch)
        state = called(law, 2, f"{name} for a batch {batch}", start)
        wanted = map_tensors(lambda x, b=batch: x[0].expand((*b, *x.shape[1:])), given)
        told = difference(state, wanted)
        if told is not None:
            raise broken(law, 2, f"{name} for a batch {batch}: {told}", "give (..., *event) leaves")
        if kind == "state":
            for leaf in leaves(state):
                letters = "(..., *event)"
                check_tensor(law, 2, "the state at t = 0", leaf, leaf.shape, letters)
        if not all(map(torch.equal, leaves(state), leaves(start()))):
            raise broken(law, 2, f"{name} gives another {kind} each time", "it is no chance")


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


def _check_jump(law: Law, given: Driven) -> None:
    """A jump, and a second one at the same instant."""
    state, mode = _jumped(law, given)
    for what, new, old in (("state", state, given.state), ("mode", mode, given.mode)):
        told = difference(new, old)
        if told is not None:
            raise broken(law, 2, f"the {what} after a jump: {told}", "return a tree like it")
    if not law.resets and not all(map(torch.equal, leaves(state), leaves(given.state))):
        raise broken(law, 2, "jump changes the state", "say `resets`, or change the mode alone")
    again = _jumped(law, given._replace(state=state, mode=mode))
    if not all(map(torch.equal, leaves(again), leaves((state, mode)))):
        raise broken(law, 6, "a second jump at one instant changes something", "decide once")


def _jumped(law: Law, given: Driven) -> tuple[Any, Any]:
    found: tuple[Any, Any] = called(law, 2, "jump of a batch", partial(law.jump, *given))
    return found


def _check_still(law: Law, given: Driven) -> None:
    """Without an error, at t = 0."""
    if law.drives:
        return
    theta, drive = given.estimate, given.drive
    still = drive._replace(
        error=torch.zeros_like(drive.error), error_norm=torch.zeros_like(drive.error_norm)
    )
    rate = law(still, *given[1:])[0]
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
        drive, pair = given.drive, given.drive.pair
        drive = drive._replace(
            error=drive.error[..., column],
            excess=None if drive.excess is None else drive.excess[..., column],
            pair=None if pair is None else pair._replace(label=pair.label[..., column]),
        )
        own = _drawn(law, 1, drive.error.shape[-2])._replace(
            drive=drive, estimate=given.estimate[..., column]
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
        state, mode = _jumped(law, given)
        rate, d_state = law(given.drive, given.estimate, state, mode)
        given = given._replace(
            estimate=given.estimate + STEP * rate,
            state=map_tensors(lambda x, dx: x + STEP * dx, state, d_state),
            mode=mode,
        )
    return given
