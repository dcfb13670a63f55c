"""Simple bases: the input itself, a constant, several side by side, any function of a user's."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import torch
from torch import Tensor, nn

from ...checks import function, several, whole
from ...errors import ShapeError
from .basis import Basis


class Identity(Basis):
    """phi = z: gains on what is fed in. Raises `ConfigError`, `KindError`."""

    def __init__(self, n_inputs: int) -> None:
        super().__init__()
        self.n_inputs = self.n_features = whole("n_inputs", n_inputs)

    def forward(self, nn_input: Tensor) -> Tensor:
        """z (..., I)."""
        return nn_input

    def slope(self, nn_input: Tensor, features: Tensor) -> Tensor:
        """The identity (..., I, I)."""
        return torch.diag_embed(torch.ones_like(nn_input))


class Constant(Basis):
    """phi = 1: the estimate is an offset. Raises `ConfigError`, `KindError`."""

    n_features = 1

    def __init__(self, n_inputs: int) -> None:
        super().__init__()
        self.n_inputs = whole("n_inputs", n_inputs)

    def forward(self, nn_input: Tensor) -> Tensor:
        """1 (..., 1)."""
        return torch.ones_like(nn_input[..., :1])

    def slope(self, nn_input: Tensor, features: Tensor) -> Tensor:
        """0 (..., 1, I)."""
        return torch.zeros_like(nn_input).unsqueeze(-2)


class Joined(Basis):
    """Several bases of one input, one after the other. Raises `ShapeError`, `KindError`."""

    def __init__(self, bases: Sequence[Basis]) -> None:
        super().__init__()
        each = several("bases", bases, Basis)
        if len({basis.n_inputs for basis in each}) != 1:
            told = ", ".join(str(basis.n_inputs) for basis in each)
            raise ShapeError(f"bases of {told} inputs: give at least one, all of the same input")
        self.bases = nn.ModuleList(each)
        self.n_inputs = each[0].n_inputs
        self.n_features = sum(basis.n_features for basis in each)

    def forward(self, nn_input: Tensor) -> Tensor:
        """(..., N) of all of them."""
        return torch.cat([basis(nn_input) for basis in self.bases], dim=-1)


class FunctionBasis(Basis):
    """phi of a function or module of a user's, (..., I) -> (..., N), that traces.

    Its parameters are differentiated like any; to be tuned by name they must be declared, as
    `Layers` does. Raises `ConfigError`, `KindError`.
    """

    def __init__(
        self, function_: Callable[[Tensor], Tensor], n_inputs: int, n_features: int
    ) -> None:
        super().__init__()
        function("function_", function_)
        self.n_inputs = whole("n_inputs", n_inputs)
        self.n_features = whole("n_features", n_features)
        self.function_ = function_

    def forward(self, nn_input: Tensor) -> Tensor:
        """(..., N)."""
        return self.function_(nn_input)
