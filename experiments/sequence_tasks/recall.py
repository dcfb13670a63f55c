"""Associative recall: pairs are shown, then each key alone asks for the value it came with."""

from __future__ import annotations

import torch
from torch import Tensor

from ..settings.peers_config import RecallConfig
from .task import Batch, Classification, one_hot


class Recall(Classification):
    """P pairs of a key and a value, no key twice; then each key with the last input 1.

    Inputs are (2 P, B, keys + values + 1), one-hot; keys are asked for in a new order.
    """

    def __init__(self, cfg: RecallConfig) -> None:
        self.n_pairs, self.n_keys, self.n_values = cfg.n_pairs, cfg.n_keys, cfg.n_values
        self.n_inputs, self.n_outputs = cfg.n_keys + cfg.n_values + 1, cfg.n_values

    def draw(self, count: int, generator: torch.Generator) -> Batch:
        """New pairs."""
        P, K = self.n_pairs, self.n_keys
        keys = torch.rand(count, K, generator=generator).argsort(-1)[:, :P]
        values = torch.randint(self.n_values, (count, P), generator=generator)
        order = torch.rand(count, P, generator=generator).argsort(-1)
        x = torch.zeros(2 * P, count, self.n_inputs)
        x[:P, :, :K] = one_hot(keys.T, K)
        x[:P, :, K:-1] = one_hot(values.T, self.n_values)
        x[P:, :, :K] = one_hot(keys.gather(1, order).T, K)
        x[P:, :, -1] = 1.0
        target = torch.cat([values.T, values.gather(1, order).T])
        asked = x[..., -1] == 1.0
        return Batch(x, target, asked, asked, None)

    def known(self, batch: Batch) -> dict[str, float]:
        """Guessing, and recall without any matching."""
        shown = without_keys(batch.target[self.n_pairs :])
        return {**super().known(batch), "always the value shown most often": shown}

    def labels(self, batch: Batch, member: int) -> list[str]:
        """`key = value`, then `key?`."""
        x, P = batch.x[:, member], self.n_pairs
        keys = x[:, : self.n_keys].argmax(dim=-1).tolist()
        values = batch.target[:P, member].tolist()
        shown = [f"{key} = {value}" for key, value in zip(keys[:P], values, strict=True)]
        return shown + [f"{key}?" for key in keys[P:]]


def without_keys(answer: Tensor) -> float:
    """Accuracy of always answering, of answers (P, B), the one that comes most often."""
    counts = (answer.unsqueeze(0) == answer.unsqueeze(1)).sum(dim=0)
    return float(counts.amax(dim=0).double().mean()) / len(answer)
