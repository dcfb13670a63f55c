"""`check_model`: whether a reference model keeps the contract that loops build on."""

from __future__ import annotations

from functools import partial
from typing import Any, NamedTuple

import torch
from torch import Tensor

from ..checks import instance
from ..parts import ReferenceModel
from ..trees import map_tensors
from ..types import MOST_DERIVATIVES, ReferenceSample
from .forms import called, check_held, check_tensor
from .functions import SAMPLES, apart, check_function, tried_of
from .samples import check_order, drawn_sample
from .slopes import check_constants, check_slopes
from .telling import broken

#: Of the largest number: how far a derivative may be from the one by autograd.
DERIVATIVE = 1e-9
_MOST = MOST_DERIVATIVES


class Followed(NamedTuple):
    """What a model is given."""

    command: ReferenceSample
    output: Tensor  # (SAMPLES, p)
    state: Tensor  # (SAMPLES, d)


def check_model(model: ReferenceModel) -> None:
    """Raise `InterfaceError` where a reference model breaks a line of its contract, which it names.

    Raises `KindError` for what is no `ReferenceModel`.
    """
    instance("model", model, ReferenceModel)
    check_held(model, 5)
    for name, least, line in (("width", 1, 3), ("order", 0, 3), ("command_order", 0, 4)):
        value = getattr(model, name, None)
        if isinstance(value, bool) or not isinstance(value, int) or not least <= value:
            raise broken(model, line, f"{name} = {value!r}", f"set `{name}` to a whole number")
        if name != "width" and value > _MOST:
            raise broken(model, line, f"{name} = {value}", f"a sample has {_MOST} derivatives")
    given = _drawn(model)
    _check_forms(model, given)
    _check_derivatives(model, given)
    for what, of in (("rates", _rates), ("sample", _parts)):
        tried = tried_of(model, 5, what, of, given)
        check_function(tried)
        names = ["the command"] * (model.command_order + 1) + ["the output", "the state"]
        check_slopes(tried, names)
        check_constants(tried, 5)


def _rates(model: ReferenceModel, given: Followed) -> Any:
    return model.rates(*given)


def _parts(model: ReferenceModel, given: Followed) -> Any:
    return model.sample(*given)


def _drawn(model: ReferenceModel) -> Followed:
    """Random arguments; the state is drawn about the one at t = 0."""
    generator = torch.Generator().manual_seed(0)
    command = drawn_sample(model.width, model.command_order, generator)
    output = torch.randn(SAMPLES, model.width, generator=generator, dtype=torch.float64)
    for i, y in enumerate((output[0], output)):
        own = command if i else map_tensors(lambda x: x[0], command)
        state = called(model, 1, "initial_state", partial(model.initial_state, own, y))
        shape = (*y.shape[:-1], *getattr(state, "shape", ())[-1:])
        check_tensor(model, 1, "the state at t = 0", state, shape, "(..., d)")
    noise = torch.randn(*state.shape, generator=generator, dtype=torch.float64)
    return Followed(command, output, state + noise)


def _check_forms(model: ReferenceModel, given: Followed) -> None:
    for line, what, of in ((2, "rates", _rates), (3, "sample", _parts)):
        ask = partial(_asked, of, model, given)
        check_order(model, 4, what, "command_order", given.command, ask)
        found = called(model, line, f"{what} of a batch", partial(of, model, given))
        if what == "rates":
            check_tensor(model, 2, "rates", found, given.state.shape, "(..., d)")
            continue
        if not isinstance(found, ReferenceSample):
            raise broken(
                model, 3, f"sample gives a {type(found).__name__}", "return a ReferenceSample"
            )
        parts = [part for part in found.parts if part is not None]
        if len(parts) != model.order + 1 or any(x is None for x in found[: len(parts)]):
            raise broken(
                model,
                3,
                f"order = {model.order}, sample gives {len(parts) - 1} derivatives",
                "set `order` to their number, without a gap",
            )
        for name, part in zip(found._fields, parts, strict=False):
            check_tensor(model, 3, name, part, given.output.shape, "(..., p)")
        if found.command is None or not torch.equal(found.command, given.command.value):
            raise broken(
                model, 3, "the command is not beside what is followed", "command=command.value"
            )


def _asked(of: Any, model: ReferenceModel, given: Followed, command: ReferenceSample) -> Any:
    return of(model, given._replace(command=command))


def _check_derivatives(model: ReferenceModel, given: Followed) -> None:
    """Each part of the sample moves as the next one says, the output held."""
    if model.order < 1:
        return
    command = [x for x in given.command.parts if x is not None]
    ways = (*command[1:], torch.zeros_like(command[0]), model.rates(*given))

    def lower(*parts: Tensor) -> tuple[Tensor, ...]:
        own = ReferenceSample(*parts[:-1])
        return model.sample(own, given.output, parts[-1]).upto(model.order - 1)

    moves = torch.func.jvp(lower, (*command, given.state), ways)[1]
    claimed = model.sample(*given).upto(model.order)[1:]
    for k, (mine, found) in enumerate(zip(claimed, moves, strict=True)):
        if apart([mine], [found]) > DERIVATIVE:
            name, before = ReferenceSample._fields[k + 1], ReferenceSample._fields[k]
            raise broken(
                model,
                3,
                f"{name} is not the derivative of {before} in time",
                "differentiate the output along `rates`, or give a smaller `order`",
            )
