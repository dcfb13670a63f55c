"""`check_controller`: whether a controller keeps the contract that loops and solvers build on."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import torch
from torch import Tensor

from ..checks import choice, instance
from ..control import Controller
from ..parts import ReferenceModel
from ..plants import Plant
from ..signals import Reference
from ..simulation import ENGINES
from ..trees import difference, leaf_names, leaves, map_tensors
from ..types import MOST_DERIVATIVES, ControlOutput, InputGains, ReferenceSample
from .controller_bench import Asked, ControllerBench, answer, bench_of
from .controller_jumps import check_jumps
from .controller_rollout import check_rollout
from .forms import called, check_held, check_tensor, is_tree
from .functions import SAMPLES, check_function, tried_of
from .random_starts import check_start, check_weights
from .samples import check_order
from .slopes import check_constants, check_slopes, totals
from .telling import broken

_MOST = MOST_DERIVATIVES


class Own(NamedTuple):
    """What is a controller's own."""

    state: Any
    mode: Any


def check_controller(
    controller: Controller,
    plant: Plant | None = None,
    reference: Reference | None = None,
    model: ReferenceModel | None = None,
    engine: str = "auto",
) -> None:
    """Raise `InterfaceError` where a controller breaks a line of its contract, which it names.

    It is tried on the plant, or on the first of two-link arm, double integrator, two linear plants
    and a regression that it fits, following the reference, or random samples with just the
    derivatives that it asks for; if it needs a command beside them, following the output of a
    `model`, of second order if not given; at last in a short rollout by the engine, ``auto``,
    ``compiled`` or ``torch``: the compiled one takes some seconds. Of a controller with relaxed
    attention, check the one that it was relaxed from. Raises `ConfigError`, `ShapeError` for a part
    that does not fit, and `KindError` for one of a wrong type.
    """
    instance("controller", controller, Controller)
    if plant is not None:
        instance("plant", plant, Plant)
    if reference is not None:
        instance("reference", reference, Reference)
    if model is not None:
        instance("model", model, ReferenceModel)
    choice("engine", engine, ENGINES)
    check_held(controller, 5)
    order = controller.reference_order
    if isinstance(order, bool) or not isinstance(order, int) or not 0 <= order <= _MOST:
        mend = f"set it to a whole number from 0 to {_MOST}"
        raise broken(controller, 4, f"reference_order = {order!r}", mend)
    b = bench_of(controller, plant, reference, model)
    _check_start(b)
    _check_order(b)
    _check_forms(b, b.at_start())
    asked = called(controller, 3, "a few steps from t = 0", b.moved)
    _check_forms(b, asked)
    tried = tried_of(controller, 3, "forward", _moves, asked)
    check_function(tried)
    check_slopes(tried, _names(asked))
    check_constants(tried, 5)
    _check_finite_at_rest(b)
    check_jumps(b, asked)
    _check_gains(b, asked)
    check_rollout(b, engine)


def _moves(controller: Any, asked: Asked) -> Any:
    found = answer(controller, asked)
    return found.input, found.d_state


def _names(asked: Asked) -> list[str]:
    """What gradients are asked by: all that is no mode."""
    seen = [f"{name} of the measurement" for name in leaf_names(asked.measurement)]
    names = () if asked.state is None else leaf_names(asked.state)
    state = [f"{name} of the state" for name in names]
    followed = [f"{name} of the reference" for name in leaf_names(asked.reference)]
    return [*followed, *seen, *state]


def _check_start(b: ControllerBench) -> None:
    c = b.controller

    def start(batch: Sequence[int], generator: torch.Generator | None) -> Any:
        pick: Callable[[Tensor], Tensor] = lambda x: x[0].expand(*batch, *x.shape[1:])  # noqa: E731
        at = map_tensors(pick, b.reference), map_tensors(pick, b.measurement)
        found = c.initial_state(*at, batch, generator)
        if not (isinstance(found, tuple) and len(found) == 2):
            told = f"initial_state gives a {type(found).__name__}"
            raise broken(c, 2, told, "return state and mode, None where there is none")
        return Own(*found)

    check_start(c, 2, "initial_state", start)
    check_start(c, 2, "initial_weights", c.initial_weights)
    for leaf in leaves(start((SAMPLES,), None).state):
        letters = "(..., *event), or move it to the mode"
        check_tensor(c, 1, "a field of the state", leaf, leaf.shape, letters)
    weights = c.initial_weights((SAMPLES,), torch.Generator().manual_seed(0))
    called(
        c,
        2,
        "initial_state with what initial_weights gives",
        lambda: c.initial_state(b.reference, b.measurement, (SAMPLES,), None, weights),
    )
    check_weights(c, 2, "check_weights", weights, c.check_weights)


def _check_order(b: ControllerBench) -> None:
    asked = b.at_start()

    def ask(sample: ReferenceSample) -> Any:
        return answer(b.controller, asked._replace(reference=sample))

    check_order(b.controller, 4, "forward", "reference_order", b.reference, ask)


def _check_forms(b: ControllerBench, asked: Asked) -> None:
    """Of an answer, beside plant and state."""
    c, m = b.controller, len(b.plant.inputs)
    found = called(c, 3, "forward of a batch", lambda: answer(c, asked))
    if not isinstance(found, ControlOutput):
        raise broken(c, 3, f"forward gives a {type(found).__name__}", "return a ControlOutput")
    check_tensor(c, 3, "the input", found.input, (SAMPLES, m), f"(..., {m}), the plant's inputs,")
    told = difference(found.d_state, asked.state)
    if told is not None:
        mend = "return d state/dt as a tree of the state's kind and shapes"
        raise broken(c, 3, f"d_state is not like the state: {told}", mend)
    for leaf in leaves(found.d_state):
        check_tensor(c, 3, "d_state", leaf, leaf.shape, "a tree like the state")
    if not is_tree(found.signals) or isinstance(found.signals, Tensor):
        told = f"signals are a {type(found.signals).__name__}"
        raise broken(c, 3, told, "give a NamedTuple of tensors, or None")


def _check_finite_at_rest(b: ControllerBench) -> None:
    """Without any error, where roots and norms have their corners."""
    c = b.controller
    still = b._replace(
        reference=map_tensors(torch.zeros_like, b.reference),
        measurement=map_tensors(torch.zeros_like, b.measurement),
    ).at_start()
    free: Callable[[Tensor], Tensor] = lambda x: x.detach().clone().requires_grad_()  # noqa: E731
    asked = still._replace(
        reference=map_tensors(free, still.reference),
        measurement=map_tensors(free, still.measurement),
        state=map_tensors(free, still.state),
    )
    with torch.enable_grad():
        value = totals(leaves(_moves(c, asked))).sum()
    if not value.requires_grad:
        return
    by = [*leaves(asked.reference), *leaves(asked.measurement), *leaves(asked.state)]
    for found in torch.autograd.grad(value, by, materialize_grads=True):
        if not bool(found.isfinite().all()):
            raise broken(
                c,
                3,
                "a gradient is not finite where reference and measurement are 0",
                "guard roots, norms and divisions at 0 before torch.where picks",
            )


def _check_gains(b: ControllerBench, asked: Asked) -> None:
    c, m = b.controller, len(b.plant.inputs)
    output = answer(c, asked)
    found = called(c, 7, "input_gains", lambda: c.input_gains(asked.reference, output, asked.state))
    if found is None:
        return
    if not isinstance(found, InputGains):
        raise broken(c, 7, f"input_gains gives a {type(found).__name__}", "InputGains, or None")
    for name, value, shape in (
        ("measurement", found.measurement, (SAMPLES, m, b.n_measured)),
        ("drift", found.drift, (SAMPLES, m)),
    ):
        letters = f"(..., {', '.join(map(str, shape[1:]))}), inputs by measured numbers,"
        check_tensor(c, 7, f"{name} of input_gains", value, shape, letters)
