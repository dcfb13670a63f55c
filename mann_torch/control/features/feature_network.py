"""The interface of adaptive networks: features of an input, and outer weights on them."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Sequence
from typing import Any

import torch
from torch import Tensor

from ...constraints import DesignModule
from ...interface import Interface
from ...types import Features
from ..laws import Drive, Law


class FeatureNetwork(Interface, DesignModule):
    """f^ = W' sigma(x~) + ... with adaptive weights, as `MannController` uses any of them.

    Its contract (`mann_torch.testing.check_network`):

    1. `n_inputs` I, `n_hidden` N and `n_outputs` m say its sizes.
    2. Weights are a NamedTuple of the network's own, (..., *event). `initial_state` gives them of
       the batch shape it is told, and has no random number but from its generator; `check_state`
       gives that batch shape, and refuses what does not fit; `expand` gives a batch of them. What
       its `laws` keep and decide lies beside them, as `initial_laws` gives it.
    3. `features` gives sigma (..., N), `output` (..., m), `correction` (..., N), `magnitude` (...,)
       >= 0, `derivative` trees like the weights and like what laws keep. They are functions of
       their arguments and of declared constants alone, for any batch at once, decided by `where`,
       in float64. Gradients reach them all.
    4. `output` is W' hidden + what does not depend on hidden, and `correction` is W r with that W.
    5. `input_slope` gives (..., m, n), or None; it may be approximate.
    6. `outer` names those weights that are W: `output` is linear in them, with nothing else beside,
       and `features` do not depend on them. A network that names none takes no `Readouts`.
    """

    n_inputs: int
    n_hidden: int
    n_outputs: int
    #: Fields of its weights that are W, biases of the output among them.
    outer: tuple[str, ...] = ()

    @abstractmethod
    def initial_state(
        self, batch_shape: Sequence[int], generator: torch.Generator | None = None
    ) -> Any:
        """Weights at t = 0 for a batch: random from the generator, or what is stored."""

    @abstractmethod
    def check_state(self, state: Any) -> torch.Size:
        """Batch shape of weights. Raises a `ConfigError` where they do not fit."""

    @abstractmethod
    def expand(self, state: Any, batch_shape: Sequence[int]) -> Any:
        """Weights of a whole batch."""

    @abstractmethod
    def features(self, nn_input: Tensor, state: Any) -> Features:
        """Features sigma (..., N) at x~ (..., I), and what else the update law reads of them."""

    def first_features(self, nn_input: Tensor, state: Any) -> Tensor:
        """sigma (..., N) at t = 0, that a memory starts from: in any batch the same bits."""
        return self.features(nn_input, state).hidden

    @abstractmethod
    def output(self, hidden: Tensor, state: Any) -> Tensor:
        """W' hidden + ... (..., m)."""

    @abstractmethod
    def correction(self, feedback: Tensor, state: Any) -> Tensor:
        """W r (..., N) of an error feedback r (..., m): what a memory is written with."""

    @abstractmethod
    def magnitude(self, state: Any) -> Tensor:
        """Sum of the weights' Frobenius norms (...,), for the robustifying gain."""

    @property
    @abstractmethod
    def laws(self) -> tuple[Law, ...]:
        """The laws that move its weights."""

    @abstractmethod
    def initial_laws(self, batch_shape: Sequence[int]) -> tuple[Any, Any]:
        """What its laws keep and decide at t = 0: two trees, or None."""

    @abstractmethod
    def derivative(
        self,
        nn_input: Tensor,
        features: Features,
        drive: Drive,
        correction: Tensor,
        state: Any,
        laws: Any,
        mode: Any,
    ) -> tuple[Any, Any]:
        """Of the weights and of what laws keep, driven by r (..., m), with W r (..., N)."""

    @abstractmethod
    def jump(
        self,
        nn_input: Tensor,
        features: Features,
        drive: Drive,
        correction: Tensor,
        state: Any,
        laws: Any,
        mode: Any,
    ) -> tuple[Any, Any]:
        """What laws keep and decide after the decisions of one instant."""

    def input_slope(self, features: Features, state: Any, first: int, n: int) -> Tensor | None:
        """d(W' sigma)/d x~ over n inputs from number `first` (..., m, n); None: not solved for."""
        return None
