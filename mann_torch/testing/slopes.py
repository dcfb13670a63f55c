"""Gradients of a part's function: there, finite, and what differences say; constants a sample."""

from __future__ import annotations

import copy
from collections.abc import Callable, Iterator, Sequence
from functools import partial

import torch
from torch import Tensor, nn

from ..constraints import DesignModule
from .forms import called
from .functions import ROUNDING, SAMPLES, Tried, apart
from .telling import broken

#: Of a derivative by differences: step, and the largest error of the largest slope.
STEP, DIFFERENCES = 1e-6, 1e-4
#: Slopes to both sides that are further apart are a corner or a decision: nothing to compare.
CORNER = 1e-2
_Result = Callable[[Tensor], list[Tensor]]


def pattern(like: Tensor) -> Tensor:
    """Different numbers of one size, so that nothing cancels."""
    return torch.sin(1.0 + torch.arange(like.numel(), dtype=like.dtype)).reshape(like.shape)


def totals(parts: Sequence[Tensor]) -> Tensor:
    """One number a sample (SAMPLES,), of all its floating ones."""
    sums = [(pattern(x) * x).reshape(SAMPLES, -1) for x in parts if x.is_floating_point()]
    return torch.cat([torch.zeros(SAMPLES, 1, dtype=torch.float64), *sums], dim=-1).sum(dim=-1)


def along_way(x: Tensor, s: Tensor, way: Tensor) -> Tensor:
    """x + s way, for s (SAMPLES,) beside x and way (SAMPLES, *)."""
    return x + s.reshape(-1, *(1,) * (x.dim() - 1)) * way


def slopes(function: Callable[[Tensor], Tensor]) -> Tensor:
    """d function_i/d s_i at s = 0 by backpropagation, of each sample; 0 where none comes back."""
    s = torch.zeros(SAMPLES, dtype=torch.float64, requires_grad=True)
    with torch.enable_grad():
        value = function(s)
    if not value.requires_grad:
        return torch.zeros(SAMPLES, dtype=torch.float64)
    (found,) = torch.autograd.grad(value.sum(), s, materialize_grads=True)
    return found


def check_slope(
    part: object, line: int | str, told: tuple[str, str], along: Callable[[Tensor], Tensor]
) -> None:
    """Raise `InterfaceError` where backpropagation and differences along a way disagree.

    `told` is what is differentiated, and by what; `along` gives one number a sample for s
    (SAMPLES,).
    """
    what, name = told
    zero = torch.zeros(SAMPLES, dtype=torch.float64)
    found = called(part, line, f"a gradient by {name}", partial(slopes, along))
    if not bool(found.isfinite().all()):
        raise broken(
            part,
            line,
            f"the gradient of {what} by {name} is not finite",
            "`where` leaks NaN gradients: guard the arguments of what is not chosen",
        )
    with torch.no_grad():
        below, here, above = (along(zero + k * STEP) for k in (-1.0, 0.0, 1.0))
    sides = torch.stack([here - below, above - here]) / STEP
    least, most = sides.aminmax(dim=0)
    size = torch.maximum(found.abs(), sides.abs().amax(dim=0)).clamp(min=1.0)
    middle = 0.5 * (least + most)
    right = (found - middle).abs() <= DIFFERENCES * size
    right = right | ((least <= found) & (found <= most)) | (most - least > CORNER * size)
    if not bool(right.all()):
        raise broken(
            part,
            line,
            f"the gradient of {what} by {name} is not what finite differences give",
            "let gradients through: no .detach(), .item(), .data or no_grad",
        )


def check_slopes(tried: Tried, names: Sequence[str]) -> None:
    """By each of the first arguments."""
    for at, name in enumerate(names):
        if not tried.arguments[at].numel():
            continue

        def along(s: Tensor, at: int = at) -> Tensor:
            given = list(tried.arguments)
            given[at] = along_way(given[at], s, pattern(given[at]))
            return totals(tried(given))

        check_slope(tried.part, tried.line, (tried.what, name), along)


def constants_of(part: nn.Module) -> Iterator[tuple[str, DesignModule, str]]:
    """Path, owner and name of each design constant."""
    for path, module in part.named_modules():
        if isinstance(module, DesignModule):
            for name in module.domains():
                yield path, module, name


def check_constants(tried: Tried, line: int | str, gradients: bool = True) -> None:
    """One with a batch shape gives each sample its own; `gradients`: and they reach it."""
    twin = called(tried.part, line, "a copy of it", lambda: copy.deepcopy(tried.part))
    for path, owner, name in list(constants_of(twin)):
        value = getattr(owner, name).detach()
        if value.dim() > owner.domains()[name].event_dims:
            continue  # it has a batch shape as it is

        def result(tensor: Tensor, owner: DesignModule = owner, name: str = name) -> list[Tensor]:
            if name in owner._parameters:
                delattr(owner, name)
            setattr(owner, name, tensor)
            return tried.of(twin, list(tried.arguments))

        def along(s: Tensor, value: Tensor = value, result: _Result = result) -> Tensor:
            rows = value.expand(SAMPLES, *value.shape)
            return totals(result(along_way(rows, s, rows)))

        shown = f"the constant {path}.{name}".replace(" .", " ")
        rows = _spread(owner, name, value)
        if rows is not None:
            _check_rows(tried, line, shown, rows, result)
        # What is 0 has no proportion to move in.
        if gradients and bool((value != 0).any()):
            check_slope(tried.part, line, (tried.what, shown), along)
        result(value)


def _spread(owner: DesignModule, name: str, value: Tensor) -> Tensor | None:
    """A value a sample (SAMPLES, *event), all in the constant's domain; None: there are none."""
    k = torch.arange(SAMPLES, dtype=torch.float64).reshape(-1, *(1,) * value.dim())
    for rows in (value * (1.0 + 0.02 * k), value * (1.0 - 0.02 * k), value + 0.02 * k):
        if not torch.equal(rows[0], rows[-1]) and owner.domains()[name].contains(rows):
            return rows
    return None


def _check_rows(tried: Tried, line: int | str, shown: str, rows: Tensor, result: _Result) -> None:
    part, what = tried.part, f"{tried.what} with {shown} of shape {tuple(rows.shape)}"
    mend = "a constant is (..., *event): unsqueeze it beside what it scales"
    together, shapes = called(part, line, what, lambda: result(rows)), [x.shape for x in tried()]
    if [x.shape for x in together] != shapes:
        raise broken(part, line, f"{what} has another shape than before", mend)
    for i in (0, SAMPLES - 1):
        if apart([x[i] for x in together], [x[i] for x in result(rows[i])]) > ROUNDING:
            raise broken(part, line, f"{what} does not give each sample its own", mend)
