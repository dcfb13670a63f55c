"""What every part owes that is a function of tensors: pure, batched, mapped over."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any, NamedTuple

import torch
from torch import Tensor, nn
from torch.overrides import TorchFunctionMode

from ..errors import DtypeError
from ..telling import misread
from ..trees import leaves, rebuilt
from .forms import called
from .telling import broken

SAMPLES = 8
#: Of the largest number in question: what rounding may do to equal numbers.
ROUNDING = 1e-12


class Tried(NamedTuple):
    """A function of a part, with a batch of arguments, all different."""

    part: nn.Module
    line: int | str  # of its contract
    what: str  # how an error calls it
    of: Callable[[Any, list[Tensor]], list[Tensor]]  # of the part, or a twin, and arguments
    arguments: list[Tensor]  # (SAMPLES, *) each

    def __call__(self, arguments: Sequence[Tensor] | None = None) -> list[Tensor]:
        """What it gives for these arguments, or for its own."""
        given = self.arguments if arguments is None else arguments
        return self.of(self.part, list(given))


def tried_of(
    part: nn.Module, line: int | str, what: str, of: Callable[[Any, Any], Any], given: Any
) -> Tried:
    """A function of trees: of the part, or a twin, and of what is like `given`."""
    return Tried(
        part, line, what, lambda p, parts: leaves(of(p, rebuilt(given, parts))), leaves(given)
    )


def apart(one: Sequence[Tensor], other: Sequence[Tensor]) -> float:
    """Largest difference, of the largest number, or 1; inf where one is no number."""
    worst = 0.0
    for a, b in zip(one, other, strict=True):
        if not a.numel():
            continue
        a, b = a.detach().to(torch.float64), b.detach().to(torch.float64)
        scale = max(1.0, float(a.abs().max()), float(b.abs().max()))
        gap = float((a - b).abs().max())
        worst = max(worst, gap / scale if gap == gap else float("inf"))
    return worst


def check_function(tried: Tried) -> None:
    """Raise `InterfaceError` unless it is pure, and the same alone, in any batch and mapped."""
    check_pure(tried)
    check_batch(tried)
    check_mapped(tried)


class _InFloat64(TorchFunctionMode):
    """Refuses float32 numbers that float64 would hold otherwise, where they are made."""

    def __torch_function__(
        self, function: Any, types: Any, arguments: Any = (), keywords: Any = None
    ) -> Any:
        made = function(*arguments, **(keywords or {}))
        if isinstance(made, Tensor) and made.dtype == torch.float32 and misread(made):
            raise DtypeError(f"{misread(made)} in float32; give dtype=torch.float64")
        return made


def check_pure(tried: Tried) -> None:
    """Same arguments, same bits, of float64 numbers alone; nothing is written to."""
    part, line, what, *_ = tried
    with _InFloat64():
        called(part, line, what, tried.__call__)
    given = [argument.clone() for argument in tried.arguments]
    held = {name: tensor.clone() for name, tensor in _tensors(part).items()}
    first = [leaf.clone() for leaf in tried()]
    if not all(map(torch.equal, given, tried.arguments)):
        raise broken(part, line, f"{what} writes into its arguments", "compute new tensors")
    tried([x.flip(0) for x in given])
    # Twice: what is kept may come back every other time.
    again = [*tried(), *tried()]
    for name, tensor in _tensors(part).items():
        if name not in held or not torch.equal(tensor, held[name]):
            raise broken(part, line, f"{what} changes {name}", "what changes is state, not module")
    if not all(map(torch.equal, [*first, *first], again)):
        raise broken(
            part,
            line,
            f"{what} gives other numbers for the same arguments",
            "it must depend on its arguments alone: no random numbers, nothing kept between calls",
        )


def _tensors(module: nn.Module) -> dict[str, Tensor]:
    """Parameters and buffers of the module by name."""
    return {**dict(module.named_parameters()), **dict(module.named_buffers())}


def check_batch(tried: Tried) -> None:
    """A sample of a batch is what it is alone, and batches may have several dimensions."""
    part, line, what, *_ = tried
    together = tried()
    for i in range(SAMPLES):
        single = [x[i] for x in tried.arguments]
        alone = called(part, line, f"{what} of a single sample", partial(tried.__call__, single))
        row = [leaf[i] for leaf in together]
        if [a.shape for a in alone] != [r.shape for r in row]:
            raise broken(
                part, line, f"{what} of a single sample is no row", "allow no batch at all"
            )
        if apart(alone, row) > ROUNDING:
            raise broken(
                part,
                line,
                f"sample {i} of a batch has another {what} than the same arguments alone",
                "samples must not mix: work along the last dimensions only",
            )
    folded = [x.unflatten(0, (2, -1)) for x in tried.arguments]
    grid = called(part, line, f"{what} of a batch (2, 4)", partial(tried.__call__, folded))
    wanted = [(2, SAMPLES // 2, *x.shape[1:]) for x in together]
    if [tuple(x.shape) for x in grid] != wanted or (
        apart([x.flatten(0, 1) for x in grid], together) > ROUNDING
    ):
        raise broken(part, line, f"a batch (2, 4) has another {what}", "count dimensions from last")


def check_mapped(tried: Tried) -> None:
    """No decision on values in Python: those cannot be traced, nor mapped over."""
    part, line, what, *_ = tried
    mapped = called(
        part,
        line,
        f"{what} under torch.func.vmap",
        lambda: torch.func.vmap(lambda *xs: tuple(tried(xs)))(*tried.arguments),
    )
    if apart(mapped, tried()) > ROUNDING:
        raise broken(part, line, f"{what} differs under torch.func.vmap", "use torch.where")
