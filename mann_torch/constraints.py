"""Design constants with a domain: found, set and freed for tuning by name.

A constant is an `nn.Parameter` holding its natural value, so that `.grad` is the derivative with
respect to the constant itself. It is frozen until `tune` names it. Values are checked whenever
they are set through this module; reading one costs nothing.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any, cast

import torch
from torch import Tensor, nn

from .checks import instance, sizes, text
from .domains import (
    Domain,
    Finite,
    FiniteRow,
    NonNegative,
    NonNegativeRow,
    Positive,
    PositiveRow,
    SymmetricPositiveDefinite,
)
from .errors import ConfigError, InterfaceError, ShapeError
from .functional import Numbers, as_float64

__all__ = [
    "DesignModule",
    "Domain",
    "Finite",
    "FiniteRow",
    "NonNegative",
    "NonNegativeRow",
    "Positive",
    "PositiveRow",
    "SymmetricPositiveDefinite",
    "follow_dtype",
    "held_tensors",
]


def _checked(name: str, value: Numbers, domain: Domain, event_shape: torch.Size) -> Tensor:
    tensor = domain.coerce(as_float64(value, name).detach(), event_shape)
    if domain.event_dims and tensor.shape[-domain.event_dims :] != event_shape:
        raise ShapeError(
            f"{name} has shape {tuple(tensor.shape)}; its last dimensions must be "
            f"{tuple(event_shape)}"
        )
    return domain.check(name, tensor).clone()


class DesignModule(nn.Module):
    """A module that owns design constants. What it holds stays float64 under `.float()`.

    Not where it `follows_dtype`, as the parts of a `MemoryCell` do (`follow_dtype`).
    """

    #: Whether `.float()` and the like convert what it holds.
    follows_dtype = False

    def __init__(self) -> None:
        super().__init__()
        self._domains: dict[str, Domain] = {}

    def declare(
        self, name: str, value: Numbers, domain: Domain, event_shape: tuple[int, ...] = ()
    ) -> None:
        """Add the constant `name`, shape (...,) plus `event_shape`. Raises as `initialize`."""
        if "_domains" not in vars(self):
            raise InterfaceError(
                f"{type(self).__name__}: call super().__init__() before {name!r} is declared"
            )
        shape = torch.Size(sizes("event_shape", event_shape))
        tensor = _checked(text("name", name), value, instance("domain", domain, Domain), shape)
        self._domains[name] = domain
        self.register_parameter(name, nn.Parameter(tensor, requires_grad=False))

    def _owners(self) -> Iterator[tuple[str, DesignModule]]:
        for module in self.modules():
            if isinstance(module, DesignModule):
                for name in module._domains:
                    yield name, module

    def domains(self) -> dict[str, Domain]:
        """Domain by name of the constants of this very module, without its parts."""
        return dict(self._domains)

    def owner(self, name: str) -> DesignModule:
        """The part that holds the constant `name`; `ConfigError` if not just one does."""
        owners = list(self._owners())
        found = [owner for known, owner in owners if known == name]
        if not found:
            known = ", ".join(name for name, _ in owners)
            raise ConfigError(f"no design constant '{name}'; choose from {known}")
        if len(found) > 1:
            parts = ", ".join(type(owner).__name__ for owner in found)
            raise ConfigError(f"'{name}' is a design constant of {parts}: address one of them")
        return found[0]

    def constants(self) -> dict[str, nn.Parameter]:
        """Every design constant of this module and its parts, by name.

        Raises `ConfigError` where two parts use one name.
        """
        return {name: self.constant(name) for name, _ in self._owners()}

    def constant(self, name: str) -> nn.Parameter:
        """The constant `name`, wherever it lives; raises `ConfigError` if there is none."""
        return cast(nn.Parameter, getattr(self.owner(name), name))

    def domain(self, name: str) -> Domain:
        """The domain of the constant `name`."""
        return self.owner(name)._domains[name]

    def initialize(self, **values: Numbers) -> None:
        """Set constants by name, all or none. A leading batch shape gives each sample its own.

        New `nn.Parameter`s replace the old ones: set values before `tune` and an optimizer.
        Raises `ConfigError` for an unknown name, `DomainError` for a value outside the domain and
        `ShapeError` for a matrix-valued constant of the wrong size.
        """
        owners = {name: self.owner(name) for name in values}
        checked = {name: owners[name]._accepted(name, value) for name, value in values.items()}
        for name, new in checked.items():
            owners[name]._replace(name, new)

    def _accepted(self, name: str, value: Numbers) -> Tensor:
        """A new value for our constant `name`, checked, where the old one is."""
        domain, old = self._domains[name], cast(Tensor, getattr(self, name))
        event_shape = old.shape[old.dim() - domain.event_dims :]
        return _checked(name, value, domain, event_shape).to(old)

    def _replace(self, name: str, value: Tensor) -> None:
        grad = cast(Tensor, getattr(self, name)).requires_grad
        self.__dict__.pop(name, None)  # a tensor that was shared
        self.register_parameter(name, nn.Parameter(value, requires_grad=grad))

    def share(self, name: str, tensor: Tensor) -> None:
        """Let the constant `name` be this very tensor, so that gradients reach it.

        Raises `ConfigError` for an unknown name, `KindError`, `DtypeError` or `DomainError`.
        """
        owner = self.owner(name)
        value = instance(name, tensor, Tensor).detach()
        value = value.double() if owner.follows_dtype else as_float64(value, name)
        owner._domains[name].check(name, value)
        delattr(owner, name)
        setattr(owner, name, tensor)

    def tune(self, *names: str) -> list[nn.Parameter]:
        """Let gradients reach exactly the named constants; freeze all others. Returns them.

        `shift_threshold` enters by comparison alone: its gradient is None, or 0, unless attention
        is relaxed.
        """
        chosen: list[nn.Parameter] = [self.constant(name) for name in names]
        for parameter in self.constants().values():
            parameter.requires_grad_(False)
        for parameter in chosen:
            parameter.requires_grad_(True)
        for name, parameter in zip(names, chosen, strict=True):
            if self.domain(name).event_dims:
                parameter.register_hook(self.domain(name).project_gradient)
        return chosen

    def check(self) -> None:
        """Raise `DomainError` if a constant has left its domain, by an optimizer's step, say."""
        for name, owner in self._owners():
            owner._domains[name].check(name, getattr(owner, name).detach())
        for module in self.modules():
            if isinstance(module, DesignModule):
                module.check_together()

    def check_together(self) -> None:
        """Raise `DomainError` if constants of this very module do not go together."""

    def batch_shape(self) -> torch.Size:
        """Batch shape of all constants together. Raises `ShapeError` if they do not broadcast."""
        shapes = {
            name: getattr(owner, name).shape[: -owner._domains[name].event_dims or None]
            for name, owner in self._owners()
        }
        try:
            return torch.broadcast_shapes(*shapes.values())
        except RuntimeError:
            batched = ", ".join(f"{name} {tuple(s)}" for name, s in shapes.items() if s)
            raise ShapeError(f"batch shapes of constants do not broadcast: {batched}") from None

    def _load_from_state_dict(
        self, state_dict: dict[str, Any], prefix: str, *arguments: Any
    ) -> None:
        # A saved constant may have another batch shape than ours, and must be in its domain. One of
        # the same shape is copied, so that an optimizer keeps its parameter.
        saved = {n: state_dict[prefix + n] for n in self._domains if prefix + n in state_dict}
        if self.follows_dtype:
            saved = {n: instance(n, value, Tensor).double() for n, value in saved.items()}
        for name, value in saved.items():
            self._domains[name].check(name, as_float64(value, name).detach())
        mine = {name: self._parameters[name] for name in saved if name in self._parameters}
        same = {n for n, p in mine.items() if p is not None and p.shape == saved[n].shape}
        checked = {n: self._accepted(n, v) for n, v in saved.items() if n not in same}
        for name, value in checked.items():
            self._replace(name, value)
        super()._load_from_state_dict(state_dict, prefix, *arguments)

    def _apply(self, fn: Callable[[Tensor], Tensor], recurse: bool = True) -> Any:
        """`.to(device)` moves, `.double()` mends; `.float()` and the like leave what is finer."""

        def keep(tensor: Tensor) -> Tensor:
            moved = fn(tensor)
            if self.follows_dtype:
                return moved
            floats = tensor.is_floating_point() and moved.is_floating_point()
            if moved.dtype == tensor.dtype or (floats and moved.itemsize > tensor.itemsize):
                return moved
            return tensor.to(moved.device)

        return super()._apply(keep, recurse)


def follow_dtype(module: nn.Module) -> None:
    """Let a module and its parts go along with `.float()`, `.double()` and `.to(dtype)`."""
    for part in module.modules():
        if isinstance(part, DesignModule):
            part.follows_dtype = True


def held_tensors(module: nn.Module) -> dict[str, Tensor]:
    """Parameters, buffers, and design constants that are shared tensors, by dotted name."""
    found: dict[str, Tensor] = {
        **dict(module.named_parameters()),
        **dict(module.named_buffers()),
    }
    for prefix, part in module.named_modules():
        if isinstance(part, DesignModule):
            for name in part.domains():
                dotted = f"{prefix}.{name}" if prefix else name
                found.setdefault(dotted, getattr(part, name))
    return found
