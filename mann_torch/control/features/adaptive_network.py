"""The two-layer adaptive network and its update laws."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import torch
from torch import Tensor

from ...checks import NONNEGATIVE, instance, number, sizes, whole
from ...errors import ConfigError, ShapeError
from ...functional import (
    Numbers,
    as_float64,
    frobenius,
    number_by_number,
    row_times,
    times_column,
)
from ...trees import leaves
from ...types import Features, NetworkState
from ..laws import AdaptiveLaw, ConstantGain, Drive, EModification, Law
from .feature_network import FeatureNetwork
from .network_laws import NO_LAWS, LawTrees, as_columns, of_network

#: Defaults: C_w, C_v and kappa of the paper.
_RATES = (10.0, 10.0, 0.0)
#: Trailing dimensions of W, b_w, V and b_v.
_EVENT_DIMS = (2, 1, 2, 1)


def _is(value: Numbers, default: float) -> bool:
    return isinstance(value, float) and value == default


class AdaptiveNetwork(FeatureNetwork):
    """f^ = W' sigma(V' x~ + b_v) + b_w with weights that move by the paper's eq. (NNupdate).

    dW/dt = C_w ((sigma - sigma' V'x~) r' - kappa |e| W), dV/dt = C_v (x~ (sigma' W r)' - kappa |e|
    V), and so the biases, on 1: `rate_W`, `rate_V` are C_w, C_v and `e_modification` is kappa.
    `law_W` and `law_V` put laws of one's own in their place. W and b_w start at 0, V and b_v
    from a normal law of standard deviation `initial_std` (0 would keep all neurons identical).
    The buffers `initial_V` (I, N) and `initial_b_v` (N,) hold one such draw.

    Raises `KindError`, and `ConfigError` for sizes below 1, a negative `initial_std`, or a law that
    needs what inner weights do not have.
    """

    outer = ("W", "b_w")

    def __init__(
        self,
        n_inputs: int,
        n_hidden: int,
        n_outputs: int,
        rate_W: Numbers = _RATES[0],
        rate_V: Numbers = _RATES[1],
        e_modification: Numbers = _RATES[2],
        initial_std: float = 0.1,
        law_W: Law | None = None,
        law_V: Law | None = None,
    ) -> None:
        super().__init__()
        laws = {"law_W": law_W, "law_V": law_V}
        given = {name for name, law in laws.items() if law is not None}
        for name in given:
            of_network(name, laws[name])
        set_ = {"law_W": rate_W, "law_V": rate_V}
        if any(not _is(set_[name], _RATES[0]) for name in given):
            raise ConfigError("rate_W, rate_V: a law that is given has a gain of its own")
        if len(given) == 2 and not _is(e_modification, _RATES[2]):
            raise ConfigError("e_modification: laws that are given have leaks of their own")
        self.n_inputs, self.n_hidden = whole("n_inputs", n_inputs), whole("n_hidden", n_hidden)
        self.n_outputs = whole("n_outputs", n_outputs)
        self.initial_std = number("initial_std", initial_std, NONNEGATIVE)
        leak = EModification(e_modification)  # one constant, of both laws
        if law_W is None:
            law_W = AdaptiveLaw(ConstantGain(rate_W, "rate_W"), leak)
        if law_V is None:
            law_V = AdaptiveLaw(ConstantGain(rate_V, "rate_V"), leak)
        self.law_W, self.law_V = law_W, law_V
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

    def initial_laws(self, batch_shape: Sequence[int]) -> tuple[Any, Any]:
        """Of W, b_w, V and b_v, each None where its law keeps nothing."""
        wide = [(self.n_hidden, self.n_outputs), (1, self.n_outputs)]
        wide += [(self.n_inputs, self.n_hidden), (1, self.n_hidden)]
        each = list(zip(self.laws, wide, strict=True))
        state = LawTrees(*(law.initial_state(*size, batch_shape) for law, size in each))
        mode = LawTrees(*(law.initial_mode(*size, batch_shape) for law, size in each))
        return state if leaves(state) else None, mode if leaves(mode) else None

    def derivative(
        self,
        nn_input: Tensor,
        features: Features,
        drive: Drive,
        correction: Tensor,
        state: NetworkState,
        laws: LawTrees | None,
        mode: LawTrees | None,
    ) -> tuple[NetworkState, LawTrees | None]:
        """Of W and b_w, driven by r, and of V and b_v, by sigma' W r: eq. (NNupdate)."""
        drives = self._drives(nn_input, features, drive, correction)
        held = laws or NO_LAWS, mode or NO_LAWS
        each = zip(self.laws, drives, as_columns(state), *held, strict=True)
        moved = [law(*given) for law, *given in each]
        W, b_w, V, b_v = (rate for rate, _ in moved)
        rates = NetworkState(W, b_w.squeeze(-2), V, b_v.squeeze(-2))
        return rates, None if laws is None else LawTrees(*(own for _, own in moved))

    def jump(
        self,
        nn_input: Tensor,
        features: Features,
        drive: Drive,
        correction: Tensor,
        state: NetworkState,
        laws: LawTrees | None,
        mode: LawTrees | None,
    ) -> tuple[LawTrees | None, LawTrees | None]:
        """The laws' decisions."""
        drives = self._drives(nn_input, features, drive, correction)
        held = laws or NO_LAWS, mode or NO_LAWS
        each = zip(self.laws, drives, as_columns(state), *held, strict=True)
        after = [law.jump(*given) for law, *given in each]
        return (
            None if laws is None else LawTrees(*(own for own, _ in after)),
            None if mode is None else LawTrees(*(decided for _, decided in after)),
        )

    @property
    def laws(self) -> tuple[Law, ...]:
        """Of W, b_w, V and b_v: a bias is a row of weights on 1."""
        return self.law_W, self.law_W, self.law_V, self.law_V

    def _drives(
        self, nn_input: Tensor, features: Features, drive: Drive, correction: Tensor
    ) -> list[Drive]:
        one = torch.ones_like(nn_input[..., :1, None])
        above = (features.hidden - features.slope * features.pre).unsqueeze(-1)
        back = (features.slope * correction).unsqueeze(-2)
        below = drive._replace(regressor=nn_input.unsqueeze(-1), error=back)
        return [
            drive._replace(regressor=above),
            drive._replace(regressor=one),
            below,
            below._replace(regressor=one),
        ]

    def input_slope(self, features: Features, state: NetworkState, first: int, n: int) -> Tensor:
        """d(W' sigma)/d x~ over `n` inputs from number `first`: W' diag(sigma') V', (..., n, n)."""
        rows = state.V[..., first : first + n, :] * features.slope.unsqueeze(-2)
        return (rows @ state.W).mT
