"""Features with inertia: a hidden layer that follows its input over time constants of its own."""

from __future__ import annotations

import math

import torch
from torch import Tensor, nn

from ...checks import whole

#: Time constants that features begin with, in steps: between these, evenly by their logarithm.
SHORTEST, LONGEST = 1.0, 60.0
#: Largest share of a step that a feature moves at first.
MOST = 0.9


class Inertia(nn.Module):
    """d sigma/dt = pace (tanh(a + U_a sigma) - sigma), pace = log(1 + exp(b + U_b sigma)).

    a and b (..., N) come of x alone. Over a step of 1 with target and pace held, the exact
    solution is sigma + sigmoid(b + U_b sigma)(tanh(a + U_a sigma) - sigma): a gated recurrent unit.
    `pace` is the layer that gives b; its bias begins at time constants between 1 and 60 steps, so
    that some features remember from the start. `first` (N,), learned, is sigma before the first
    step. Raises `ConfigError`.
    """

    def __init__(self, input_size: int, hidden_size: int) -> None:
        super().__init__()
        input_size = whole("input_size", input_size)
        hidden_size = whole("hidden_size", hidden_size)
        self.pace = nn.Linear(input_size, hidden_size)
        self.feedback = nn.Linear(hidden_size, hidden_size, bias=False)
        self.pace_feedback = nn.Linear(hidden_size, hidden_size, bias=False)
        self.first = nn.Parameter(2.0 * torch.rand(hidden_size) - 1.0)
        span = math.log(LONGEST) - math.log(SHORTEST)
        share = torch.exp(-(math.log(SHORTEST) + span * torch.rand(hidden_size))).clamp(max=MOST)
        with torch.no_grad():
            self.pace.bias.copy_(torch.logit(share))
        for layer in (self.pace, self.feedback, self.pace_feedback):
            self.begin(layer.weight)

    @staticmethod
    def begin(weight: Tensor) -> None:
        """Fill a weight (N, anything) as `nn.LSTM` does: uniform within 1 / sqrt(N) of 0."""
        bound = len(weight) ** -0.5
        nn.init.uniform_(weight, -bound, bound)

    def forward(self, target: Tensor, pace: Tensor, before: Tensor) -> Tensor:
        """sigma (..., N) a step later, from a, b and sigma before, each (..., N)."""
        moved = torch.tanh(target + self.feedback(before)) - before
        return before + torch.sigmoid(pace + self.pace_feedback(before)) * moved
