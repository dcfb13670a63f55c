"""The two-layer adaptive network and its update laws."""

from __future__ import annotations

from collections.abc import Sequence

import torch
from torch import Tensor

from ..checks import NONNEGATIVE, instance, number, sizes, whole
from ..constraints import NonNegative
from ..errors import ConfigError, ShapeError
from ..functional import (
    Numbers,
    as_float64,
    frobenius,
    number_by_number,
    outer,
    row_times,
    times_column,
)
from ..types import Features, NetworkState
from .feature_network import FeatureNetwork

#: Trailing dimensions of W, b_w, V and b_v.
_EVENT_DIMS = (2, 1, 2, 1)


class AdaptiveNetwork(FeatureNetwork):
    """f^ = W' sigma(V' x~ + b_v) + b_w with weights that move by the paper's eq. (NNupdate).

    `rate_W`, `rate_V` are C_w, C_v and `e_modification` is kappa. W and b_w start at 0, V and b_v
    from a normal law of standard deviation `initial_std` (0 would keep all neurons identical).
    The buffers `initial_V` (I, N) and `initial_b_v` (N,) hold one such draw.

    Raises `KindError`, and `ConfigError` for sizes below 1 or a negative `initial_std`.
    """

    def __init__(
        self,
        n_inputs: int,
        n_hidden: int,
        n_outputs: int,
        rate_W: Numbers = 10.0,
        rate_V: Numbers = 10.0,
        e_modification: Numbers = 0.0,
        initial_std: float = 0.1,
    ) -> None:
        super().__init__()
        self.n_inputs, self.n_hidden = whole("n_inputs", n_inputs), whole("n_hidden", n_hidden)
        self.n_outputs = whole("n_outputs", n_outputs)
        self.initial_std = number("initial_std", initial_std, NONNEGATIVE)
        self.rate_W: Tensor
        self.rate_V: Tensor
        self.e_modification: Tensor
        self.declare("rate_W", rate_W, NonNegative())
        self.declare("rate_V", rate_V, NonNegative())
        self.declare("e_modification", e_modification, NonNegative())
        self.initial_V: Tensor
        self.initial_b_v: Tensor
        draw = self._draw((), torch.Generator().manual_seed(0))
        self.register_buffer("initial_V", draw.V)
        self.register_buffer("initial_b_v", draw.b_v)

    def _draw(self, batch_shape: Sequence[int], generator: torch.Generator) -> NetworkState:
        normal = torch.randn(
            *batch_shape, self.n_inputs + 1, self.n_hidden, generator=generator, dtype=torch.float64
        )
        normal = self.initial_std * normal
        return self.from_inner_weights(normal[..., :-1, :], normal[..., -1, :])

    def from_inner_weights(self, V: Tensor, b_v: Tensor) -> NetworkState:
        """Initial weights with W = 0, b_w = 0 from V (..., I, N) and b_v (..., N)."""
        batch = V.shape[:-2]
        W = V.new_zeros((*batch, self.n_hidden, self.n_outputs))
        return NetworkState(W, V.new_zeros((*batch, self.n_outputs)), V, b_v)

    def initial_state(
        self, batch_shape: Sequence[int], generator: torch.Generator | None = None
    ) -> NetworkState:
        """Weights at t = 0 for a batch: random from the generator, or the stored draw.

        Raises `KindError`.
        """
        batch_shape = sizes("batch_shape", batch_shape)
        if generator is not None:
            return self._draw(batch_shape, instance("generator", generator, torch.Generator))
        V = self.initial_V.expand(*batch_shape, -1, -1)
        return self.from_inner_weights(V, self.initial_b_v.expand(*batch_shape, -1))

    def check_state(self, state: NetworkState) -> torch.Size:
        """Batch shape of weights.

        Raises for those of the wrong shape, of a dtype but float64, or not finite, and `ShapeError`
        where their batch shapes do not broadcast.
        """
        instance("weights", state, NetworkState)
        n_inputs, n_hidden, n_outputs = self.n_inputs, self.n_hidden, self.n_outputs
        events = [(n_hidden, n_outputs), (n_outputs,), (n_inputs, n_hidden), (n_hidden,)]
        for (name, leaf), event in zip(state._asdict().items(), events, strict=True):
            if not isinstance(leaf, Tensor):
                raise ConfigError(f"initial {name} is {type(leaf).__name__}, not a torch.Tensor")
            as_float64(leaf, f"initial {name}")
            if leaf.shape[-len(event) :] != event:
                raise ShapeError(
                    f"initial {name} has shape {tuple(leaf.shape)}, not (..., {event})"
                )
            if not bool(torch.isfinite(leaf).all()):
                raise ConfigError(f"initial {name}: not all numbers are finite")
        batches = [tuple(leaf.shape[:-k]) for leaf, k in zip(state, _EVENT_DIMS, strict=True)]
        try:
            return torch.broadcast_shapes(*batches)
        except RuntimeError:
            raise ShapeError(
                f"batch shapes {batches} of initial weights do not broadcast"
            ) from None

    def expand(self, state: NetworkState, batch_shape: Sequence[int]) -> NetworkState:
        """Weights of a whole batch."""
        return NetworkState(
            *(
                leaf.expand(*batch_shape, *leaf.shape[-k:])
                for leaf, k in zip(state, _EVENT_DIMS, strict=True)
            )
        )

    def features(self, nn_input: Tensor, state: NetworkState) -> Features:
        """V' x~ + b_v, sigma of it, and sigma's slope, each (..., N), at x~ (..., I)."""
        pre = row_times(nn_input, state.V) + state.b_v
        hidden = torch.sigmoid(pre)
        return Features(pre, hidden, hidden * (1.0 - hidden))

    def first_features(self, nn_input: Tensor, state: NetworkState) -> Tensor:
        """sigma (..., N), number by number: the same bits in any batch."""
        return torch.sigmoid(number_by_number(self.features(nn_input, state).pre))

    def output(self, hidden: Tensor, state: NetworkState) -> Tensor:
        """W' hidden + b_w (..., n); with hidden = sigma + h_o this is -u_ad (eq. nnoutput)."""
        return row_times(hidden, state.W) + state.b_w

    def correction(self, feedback: Tensor, state: NetworkState) -> Tensor:
        """W r (..., N) of an error feedback r (..., n)."""
        return times_column(state.W, feedback)

    def magnitude(self, state: NetworkState) -> Tensor:
        """|W|_F + |V|_F (...,)."""
        return frobenius(state.W) + frobenius(state.V)

    def derivative(
        self,
        nn_input: Tensor,
        features: Features,
        feedback: Tensor,
        correction: Tensor,
        error_norm: Tensor,
        state: NetworkState,
    ) -> NetworkState:
        """Update law (eq. NNupdate) for error feedback h_e' = r (..., n).

        `correction` is W r (..., N) and `error_norm` |e| (...,).
        """
        decay = (self.e_modification * error_norm).unsqueeze(-1)
        regressor = features.hidden - features.slope * features.pre
        back = features.slope * correction
        rate_W, rate_V, matrix_decay = (
            self.rate_W.unsqueeze(-1),
            self.rate_V.unsqueeze(-1),
            decay.unsqueeze(-1),
        )
        return NetworkState(
            W=outer(rate_W * regressor, feedback).addcmul(
                rate_W.unsqueeze(-1) * matrix_decay, state.W, value=-1
            ),
            b_w=rate_W * torch.addcmul(feedback, decay, state.b_w, value=-1),
            V=outer(rate_V * nn_input, back).addcmul(
                rate_V.unsqueeze(-1) * matrix_decay, state.V, value=-1
            ),
            b_v=rate_V * torch.addcmul(back, decay, state.b_v, value=-1),
        )

    def input_slope(self, features: Features, state: NetworkState, first: int, n: int) -> Tensor:
        """d(W' sigma)/d x~ over `n` inputs from number `first`: W' diag(sigma') V', (..., n, n)."""
        rows = state.V[..., first : first + n, :] * features.slope.unsqueeze(-2)
        return (rows @ state.W).mT


def equal_parameter_hidden(n_inputs: int, n_outputs: int, n_hidden: int, n_slots: int) -> int:
    """Neurons of the plain network with as many parameters as a network with a memory.

    The memory counts n_s N numbers (paper, scenario 1). With I inputs, n outputs, N neurons and
    S slots the controller with memory has N (I + 1 + n + S) + n parameters; the plain network has
    N' (I + 1 + n) + n. The nearest whole N' is returned: 14 for the paper's arm.

    Raises `KindError`, and `ConfigError` for a size below 1 or fewer than no slots.
    """
    n_inputs, n_outputs = whole("n_inputs", n_inputs), whole("n_outputs", n_outputs)
    n_hidden, n_slots = whole("n_hidden", n_hidden), whole("n_slots", n_slots, least=0)
    per_neuron = n_inputs + 1 + n_outputs
    return round(n_hidden * (per_neuron + n_slots) / per_neuron)
