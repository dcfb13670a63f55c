"""What a part starts from: of the batch shape it is told, random by its generator alone."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import torch
from torch import Tensor, nn

from ..errors import ConfigError
from ..trees import difference, leaves, map_tensors
from .forms import called, is_tree
from .functions import SAMPLES
from .telling import broken

Start = Callable[[Sequence[int], torch.Generator | None], Any]


def check_start(part: nn.Module, line: int | str, what: str, start: Start) -> None:
    """Raise `InterfaceError` unless `start` gives trees of the batch shape, without other chance.

    It is called with a batch shape and a generator or None.
    """
    for seed in (None, 0):
        whole = _drawn(part, line, what, start, (SAMPLES,), seed)
        if not is_tree(whole):
            raise broken(part, line, f"{what} gives no NamedTuple of tensors", "or None, for none")
        if any(x.shape[:1] != (SAMPLES,) for x in leaves(whole)):
            shapes = [tuple(x.shape) for x in leaves(whole)]
            raise broken(
                part,
                line,
                f"{what} for a batch of {SAMPLES} has shapes {shapes}",
                "each leaf is (..., *event) with the batch shape in front",
            )
        _check_batches(part, line, what, start, whole, seed)
        with torch.random.fork_rng(devices=[]):
            torch.manual_seed(1)
            first = _drawn(part, line, what, start, (SAMPLES,), seed)
            torch.manual_seed(2)
            second = _drawn(part, line, what, start, (SAMPLES,), seed)
        if not all(map(torch.equal, leaves(first), leaves(second))):
            told = "without a generator" if seed is None else "with a generator of the same seed"
            raise broken(
                part,
                line,
                f"{what} gives other numbers each time {told}",
                "draw from the generator alone, and without one take what is stored",
            )


def check_weights(
    part: nn.Module, line: int | str, what: str, weights: Any, check: Callable[[Any], torch.Size]
) -> None:
    """Raise `InterfaceError` unless `check` gives weights' batch shape, and refuses others."""
    wanted = () if weights is None else (SAMPLES,)
    found = called(part, line, f"{what} of its own weights", lambda: tuple(check(weights)))
    if found != wanted:
        raise broken(part, line, f"{what} gives {found}, not {wanted}", "return the batch shape")
    try:
        check(object())
    except ConfigError:
        return
    except Exception as error:
        told = f"{what} of an object raises a {type(error).__name__}"
        raise broken(part, line, told, "raise a ConfigError for what does not fit") from error
    told = f"{what} takes an object for weights"
    raise broken(part, line, told, "raise a ConfigError for what does not fit")


def _check_batches(
    part: nn.Module, line: int | str, what: str, start: Start, whole: Any, seed: int | None
) -> None:
    for batch in ((2, 3), ()):

        def like(x: Tensor, batch: tuple[int, ...] = batch) -> Tensor:
            return x.new_zeros((*batch, *x.shape[1:]))

        found = _drawn(part, line, what, start, batch, seed)
        told = difference(found, map_tensors(like, whole))
        if told is not None:
            raise broken(
                part, line, f"{what} for a batch {batch}: {told}", "leaves are (..., *event)"
            )
        for x in leaves(found):
            if x.is_floating_point() and (x.dtype != torch.float64 or not bool(x.isfinite().all())):
                told = f"{x.dtype}" if x.dtype != torch.float64 else "not finite"
                raise broken(part, line, f"{what} is {told}", "start from finite float64 numbers")


def _drawn(
    part: nn.Module,
    line: int | str,
    what: str,
    start: Start,
    batch: tuple[int, ...],
    seed: int | None,
) -> Any:
    generator = None if seed is None else torch.Generator().manual_seed(seed)
    return called(part, line, f"{what} for a batch {batch}", lambda: start(batch, generator))
