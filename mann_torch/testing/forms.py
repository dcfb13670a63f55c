"""Forms of what a part gives: trees of tensors, and how two of them differ."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, TypeVar

import torch
from torch import Tensor, nn

from ..constraints import DesignModule
from ..errors import InterfaceError, ShapeError
from ..telling import explained
from .telling import broken

Result = TypeVar("Result")


def called(part: object, line: int | str, what: str, function: Callable[[], Result]) -> Result:
    """The function's result; whatever it raises becomes an `InterfaceError` that says `what`."""
    try:
        return function()
    except InterfaceError:
        raise
    except Exception as error:
        raise broken(part, line, f"{what} fails", explained(error)) from error


def is_tree(value: Any) -> bool:
    """Whether it is a NamedTuple of tensors, None and the like of it."""
    if isinstance(value, Tensor) or value is None:
        return True
    return isinstance(value, tuple) and hasattr(value, "_fields") and all(map(is_tree, value))


def has_tensor(value: Any) -> bool:
    """Whether it is a tensor, or a container of any."""
    if isinstance(value, Tensor):
        return True
    if isinstance(value, Mapping):
        value = value.values()
    elif not isinstance(value, list | tuple | set):
        return False
    return any(map(has_tensor, value))


def check_tensor(
    part: object, line: int | str, what: str, found: Any, shape: Sequence[int], letters: str
) -> Tensor:
    """`found`, if it is a finite float64 tensor of that shape; `letters` say it in an error."""
    if not isinstance(found, Tensor):
        raise broken(part, line, f"{what} is a {type(found).__name__}", f"give a tensor {letters}")
    if tuple(found.shape) != tuple(shape):
        raise broken(
            part,
            line,
            f"{what} has shape {tuple(found.shape)}, not {tuple(shape)}",
            f"give {letters} for any batch dimensions",
        )
    if found.dtype != torch.float64:
        raise broken(part, line, f"{what} is {found.dtype}", "compute in float64 throughout")
    if not bool(found.isfinite().all()):
        raise broken(part, line, f"{what} is not finite", "guard what divides or takes roots")
    return found


def check_held(part: nn.Module, line: int | str, *told: str) -> None:
    """Raise `InterfaceError` for tensors that are neither declared nor registered, or float32.

    Attributes `told` are looked at elsewhere.

    `ShapeError` for constants with a batch shape: what is checked has its own.
    """
    if isinstance(part, DesignModule) and part.batch_shape() != ():
        raise ShapeError(
            f"{type(part).__name__} has constants of batch shape {tuple(part.batch_shape())}: "
            "check it with one value of each"
        )
    for path, module in part.named_modules():
        known = module.domains() if isinstance(module, DesignModule) else {}
        for name, value in vars(module).items():
            others = ("_parameters", "_buffers", "_modules", *known, *told)
            if name in others or not has_tensor(value):
                continue
            raise broken(
                part,
                line,
                f"{f'{path}.{name}'.removeprefix('.')} is a tensor that is not registered",
                "declare a constant with its domain, or register_buffer(name, tensor)",
            )
    for name, tensor in (*part.named_parameters(), *part.named_buffers()):
        if tensor.is_floating_point() and tensor.dtype != torch.float64:
            raise broken(part, line, f"{name} is {tensor.dtype}", "hold float64 throughout")
