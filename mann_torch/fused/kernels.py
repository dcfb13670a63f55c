"""Kernels by form, made and compiled once a process and cached on disk by Warp."""

from __future__ import annotations

import functools
from collections.abc import Mapping
from typing import Any

from torch import Tensor

from ..compiled.host.kernels import LOCK
from ..errors import KernelError
from .form import Form


def kernel(form: Form, gamma: float, backward: bool, device: str) -> Any:
    """The compiled kernel of a form; its first use on a machine compiles for some seconds.

    Raises `KernelError` where it cannot be compiled or loaded.
    """
    with LOCK:
        made = _build(form, gamma, backward, device)
    if isinstance(made, KernelError):
        raise made
    return made


@functools.cache
def _build(form: Form, gamma: float, backward: bool, device: str) -> Any:
    """The kernel, or the error that comes instead, so that no failure is tried twice."""
    import warp as wp

    from .equations.march import make_march

    try:
        made = make_march(form, gamma, backward)
        wp.force_load(device=device, modules=[made.module])
    except Exception as error:  # Warp raises bare exceptions: no compiler, no room, no permission
        cause = str(error).strip().splitlines() or ["no message"]
        return KernelError(f"the fused kernel cannot be built on {device}: {cause[0]}")
    return made


class Launch:
    """A kernel with its arguments by name, ready to run over any range of samples and steps."""

    def __init__(
        self,
        made: Any,
        device: str,
        values: Mapping[str, Any],
        gradients: Mapping[str, Tensor | None] | None = None,
    ) -> None:
        self._kernel, self._device = made, device
        self._names = [argument.label for argument in made.adj.args]
        self._types = {argument.label: argument.type for argument in made.adj.args}
        self._inputs = [self._convert(name, values.get(name)) for name in self._names]
        self._commands: dict[tuple[int, int], Any] = {}
        self._gradients: list[Any] | None = None
        if gradients is not None:
            self._gradients = [
                self._convert(name, gradients.get(name)) if hasattr(kind, "dtype") else kind(0)
                for name, kind in self._types.items()
            ]

    def _convert(self, name: str, value: Any) -> Any:
        import warp as wp

        if not isinstance(value, Tensor):
            return value
        return wp.from_torch(value.detach(), dtype=self._types[name].dtype, requires_grad=False)

    def __call__(self, first: int, last: int, offset: int, size: int) -> None:
        """Steps first to last of `size` samples from number `offset` on."""
        command = self._commands.get((offset, size))
        if command is None:
            command = self._commands[offset, size] = self._record(offset, size)
        for name, value in (("first", first), ("last", last)):
            command.set_param_at_index(self._names.index(name), value)
        command.launch()

    def _record(self, offset: int, size: int) -> Any:
        """A launch with all its arguments packed: packing them each time takes a millisecond."""
        import warp as wp

        inputs = [*self._inputs]
        inputs[self._names.index("offset")] = offset
        for name in ("first", "last"):
            inputs[self._names.index(name)] = 0
        return wp.launch(
            self._kernel,
            dim=size,
            inputs=inputs,
            adj_inputs=self._gradients or [],
            adjoint=self._gradients is not None,
            device=self._device,
            record_cmd=True,
        )
