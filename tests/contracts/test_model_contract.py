"""Every reference model keeps its contract, and `check_model` refuses what does not."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest
import torch

import mann_torch as mt
from mann_torch import parts
from mann_torch.errors import InterfaceError
from mann_torch.parts import LinearModel, ReferenceModel, SecondOrderModel
from mann_torch.testing import check_model
from mann_torch.types import ReferenceSample

A, B, C = [[0.0, 1.0], [-1.0, -2.0]], [[0.0], [1.0]], [[1.0, 0.0]]
#: A new model is one line here.
MODELS_TO_CHECK: dict[str, Callable[[], ReferenceModel]] = {
    "first order": lambda: LinearModel.first_order(2.0, 0.5, 1.0),
    "linear": lambda: LinearModel(A, B, C),
    "linear, closed-loop": lambda: LinearModel(A, B, C, [[1.0], [2.0]]),
    "second order": lambda: SecondOrderModel(2, [3.0, 5.0], 0.7),
}


@pytest.mark.parametrize("name", MODELS_TO_CHECK)
def test_a_model_of_the_library_keeps_its_contract(name: str) -> None:
    check_model(MODELS_TO_CHECK[name]())


def test_the_list_has_every_model_there_is() -> None:
    public = [getattr(parts, name) for name in parts.__all__]
    kinds = {kind for kind in public if isinstance(kind, type) and issubclass(kind, ReferenceModel)}
    assert kinds - {ReferenceModel} == {type(make()) for make in MODELS_TO_CHECK.values()}


def changed(**members: Any) -> ReferenceModel:
    """A model of the second order that breaks a line."""
    return type("Broken", (SecondOrderModel,), members)(2, 3.0, 0.7)  # type: ignore[no-any-return]


def of(name: str, compute: Callable[..., Any]) -> ReferenceModel:
    """With another result of a method, of the right one and its arguments."""
    right = getattr(SecondOrderModel, name)
    return changed(**{name: lambda self, *given: compute(right(self, *given), *given)})


BROKEN: dict[str, tuple[Callable[[], ReferenceModel], str]] = {
    "an order it does not say": (lambda: changed(order="two"), "line 3: order = 'two'"),
    "too many derivatives": (lambda: changed(command_order=5), "line 4: command_order = 5"),
    "a state in a tuple": (
        lambda: of("initial_state", lambda right, *_: (right,)),
        "line 1: the state at t = 0 is a tuple",
    ),
    "a state of no batch": (
        lambda: changed(initial_state=lambda self, command, y: torch.zeros(4).double()),
        r"line 1: the state at t = 0 has shape \(4,\), not \(8, 4\)",
    ),
    "rates of another width": (
        lambda: of("rates", lambda right, *_: right[..., :2]),
        r"line 2: rates has shape \(8, 2\), not \(8, 4\)",
    ),
    "a value alone": (
        lambda: of("sample", lambda right, *_: right.value),
        "line 3: sample gives a Tensor; return a ReferenceSample",
    ),
    "a derivative less": (
        lambda: of("sample", lambda right, *_: right._replace(acceleration=None)),
        "line 3: order = 2, sample gives 1 derivatives",
    ),
    "no command beside it": (
        lambda: of("sample", lambda right, *_: right._replace(command=None)),
        "line 3: the command is not beside what is followed",
    ),
    "a derivative that is none": (
        lambda: of("sample", lambda right, *_: right._replace(rate=1.01 * right.rate)),
        "line 3: rate is not the derivative of value in time",
    ),
    "a command's rate that it does not say": (
        lambda: of("rates", lambda right, command, y, x: right + 0.0 * command.rate.sum()),
        "line 4: rates reads more than the 0 derivatives that command_order says",
    ),
    "samples that mix": (
        lambda: changed(
            order=0,
            sample=lambda self, command, y, x: ReferenceSample(
                x[..., :2] + x.mean(), command=command.value
            ),
        ),
        "line 5: sample 0 of a batch has another sample",
    ),
    "a command detached": (
        lambda: of(
            "sample",
            lambda right, command, y, x: ReferenceSample(
                *right[:2], right.acceleration.detach(), command=command.value
            ),
        ),
        "line 5: the gradient of sample by the command is not what finite",
    ),
}


@pytest.mark.parametrize("name", BROKEN)
def test_a_broken_model_is_refused_by_what_is_wrong(name: str) -> None:
    make, told = BROKEN[name]
    with pytest.raises(InterfaceError, match=rf"^\w+, contract .*(?:{told})"):
        check_model(make())


def test_what_is_no_model_is_named() -> None:
    with pytest.raises(mt.KindError, match="model = 3"):
        check_model(3)  # type: ignore[arg-type]
