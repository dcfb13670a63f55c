"""From a hard controller to its relaxed form, with the same design constants."""

from __future__ import annotations

import copy
import itertools
from typing import TypeVar, cast

import torch
from torch import Tensor, nn

from ...checks import instance
from ...constraints import DesignModule, Positive, follow_dtype
from ...errors import ConfigError
from ...functional import Numbers, as_float64
from .attention import Attention
from .hard import HardAttention
from .reallocating import ReallocatingAttention
from .relaxed import RelaxedAttention
from .soft import SoftAttention

Module = TypeVar("Module", bound=nn.Module)


def relaxed(module: Module, temperature: Numbers) -> Module:
    """A memory, controller or closed loop whose attention is relaxed to `temperature` T.

    It has the very constants and buffers of `module`: gradients land on the same `.grad`. Where
    nothing is to be relaxed (no memory, or soft attention, which is smooth), `module` itself.
    It is another view of `module`, not a copy: parts that are not on the way to its attention are
    the same objects, with their hooks and train or eval mode. Values given to `initialize` later
    may not reach both: relax what has its values, dtype and device.

    T is a float, or a float64 tensor of shape (...,); one that requires grad gets its gradient.

    Raises `DomainError` for T <= 0, `ConfigError` for attention of an unknown kind,
    `KindError` for what is no module.
    """
    instance("module", module, nn.Module)
    Positive().check("temperature", as_float64(temperature, "temperature").detach())
    return cast(Module, _exchanged(module, temperature, _like(module)))


def _like(module: nn.Module) -> Tensor:
    """A tensor on the module's device, of its dtype where parts follow that."""
    held = itertools.chain(module.parameters(), module.buffers())
    floats = (tensor for tensor in held if tensor.is_floating_point())
    return next(floats, torch.zeros((), dtype=torch.float64))


def _exchanged(module: nn.Module, temperature: Numbers, like: Tensor) -> nn.Module:
    if isinstance(module, Attention):
        return _attention(module, temperature, like)
    if isinstance(module, DesignModule):
        like = _like(module)
    parts = {name: _exchanged(part, temperature, like) for name, part in module.named_children()}
    if all(part is module._modules[name] for name, part in parts.items()):
        return module
    twin = copy.copy(module)  # its dictionaries of parameters and buffers are the same
    twin._modules = {**module._modules, **parts}
    return twin


def _attention(attention: Attention, temperature: Numbers, like: Tensor) -> Attention:
    kind = type(attention)
    if kind is SoftAttention:
        return attention
    if kind not in (HardAttention, ReallocatingAttention, RelaxedAttention):
        raise ConfigError(f"{kind.__name__} has no relaxed form")
    phase = getattr(attention, "phase", None)
    found = RelaxedAttention(temperature, phase).to(like.device)
    if attention.follows_dtype:
        follow_dtype(found)
        found.to(like.dtype)
    if isinstance(temperature, torch.Tensor) and temperature.requires_grad:
        found.share("temperature", temperature.to(found.temperature.dtype))
    if phase is not None:
        found.share("shift_threshold", attention.constant("shift_threshold"))
    return found
