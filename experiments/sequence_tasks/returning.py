"""Online regression as a sequence: the function changes abruptly, and comes back."""

from __future__ import annotations

import torch
from torch import Tensor

from ..settings.peers_config import ReturningTaskConfig
from .streams import draw_stream, uniform
from .task import Batch, Regression, relative


class Returning(Regression):
    """y_t = f_k(t)(x_t) is asked at every step, with x_t, x_t-1 and y_t-1 as inputs.

    Every sequence has K functions of its own, visited one after the other, each visit as long as
    chance has it in [shortest, longest], never the same twice running. What is judged are the
    `window` steps after the first of a return: at the first nothing tells that there was a change.
    """

    n_inputs = 3

    def __init__(self, cfg: ReturningTaskConfig) -> None:
        self.cfg = cfg

    def draw(self, count: int, generator: torch.Generator) -> Batch:
        """New functions, orders and lengths."""
        cfg, T = self.cfg, self.cfg.steps
        which, since, back = self._visits(count, generator)
        stream = draw_stream(count, cfg.n_functions, generator, cfg.n_waves)
        x = uniform(generator, T + 1, count)
        y = stream.values(torch.cat([which[:1], which]), x)
        inputs = torch.stack([x[1:], x[:-1], y[:-1]], dim=-1).float()
        judged = back & (since >= 1) & (since <= cfg.window)
        return Batch(inputs, y[1:].float(), torch.ones_like(judged), judged, None)

    def _visits(self, count: int, generator: torch.Generator) -> tuple[Tensor, Tensor, Tensor]:
        """Of every step (T, B): whose visit, how many steps into it, whether it is a return."""
        cfg, K, T = self.cfg, self.cfg.n_functions, self.cfg.steps
        n = -(-T // cfg.shortest)  # visits, at most
        lengths = torch.randint(cfg.shortest, cfg.longest + 1, (n, count), generator=generator)
        moves = torch.randint(1, K, (n, count), generator=generator)  # never to itself
        order = moves.cumsum(dim=0) % K
        earlier = torch.nn.functional.one_hot(order, K).cumsum(dim=0)
        again = earlier.gather(-1, order.unsqueeze(-1)).squeeze(-1) > 1
        ends = lengths.cumsum(dim=0)
        step = torch.arange(T).unsqueeze(-1).expand(T, count)
        visit = (ends.unsqueeze(0) <= step.unsqueeze(1)).sum(dim=1)  # (T, B)
        since = step - (ends - lengths).gather(0, visit)
        return order.gather(0, visit), since, again.gather(0, visit)

    def known(self, batch: Batch) -> dict[str, float]:
        """Answering 0, and the y before."""
        return {**super().known(batch), "the y before": relative(batch.x[..., 2], batch)}
