"""The recall task, and who learns it."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import torch
from torch import Tensor, nn

import mann_torch as mt

from ..settings.memory_config import RecallConfig


def sequences(cfg: RecallConfig, count: int, generator: torch.Generator) -> tuple[Tensor, Tensor]:
    """Inputs (2 P, B, keys + values + 1), one-hot, float32, and answers (P, B).

    First P pairs of a key and a value, no key twice; then each key alone with the last input 1, in
    a new order: the answer is the value it came with.
    """
    P = cfg.n_pairs
    keys = torch.rand(count, cfg.n_keys, generator=generator).argsort(-1)[:, :P]
    values = torch.randint(cfg.n_values, (count, P), generator=generator)
    order = torch.rand(count, P, generator=generator).argsort(-1)
    one_hot = nn.functional.one_hot
    shown = torch.cat(
        [one_hot(keys, cfg.n_keys), one_hot(values, cfg.n_values), torch.zeros(count, P, 1)], -1
    )
    asked = torch.zeros_like(shown)
    asked[..., : cfg.n_keys] = one_hot(keys.gather(1, order), cfg.n_keys)
    asked[..., -1] = 1.0
    x = torch.cat([shown, asked], dim=1).transpose(0, 1).float()
    return x, values.gather(1, order).T


def step_labels(cfg: RecallConfig, x: Tensor, right: np.ndarray) -> list[str]:
    """What each step of one sequence (2 P, I) shows or asks; `right` (P,) are its answers."""
    keys = x[:, : cfg.n_keys].argmax(dim=-1).tolist()
    values = x[: cfg.n_pairs, cfg.n_keys : -1].argmax(dim=-1).tolist()
    shown = [f"{key} = {value}" for key, value in zip(keys, values, strict=False)]
    marks = ["" if good else " !" for good in right]
    return shown + [f"{k}?{mark}" for k, mark in zip(keys[cfg.n_pairs :], marks, strict=True)]


def without_keys(answer: Tensor) -> float:
    """Accuracy of always answering the value shown most often: recall without any matching."""
    counts = (answer.unsqueeze(0) == answer.unsqueeze(1)).sum(dim=0)
    return float(counts.amax(dim=0).double().mean()) / len(answer)


class Recurrent(nn.Module):
    """nn.LSTM or nn.GRU with a linear layer on top."""

    def __init__(self, kind: type[nn.LSTM | nn.GRU], n_inputs: int, size: int, out: int) -> None:
        super().__init__()
        self.rnn, self.output = kind(n_inputs, size), nn.Linear(size, out)

    def forward(self, x: Tensor) -> Tensor:
        """Outputs (T, B, out) for x (T, B, I)."""
        return self.output(self.rnn(x)[0])


class Memory(nn.Module):
    """A cell with state keys over the sequence."""

    def __init__(self, cfg: RecallConfig, n_inputs: int, attention: mt.Attention) -> None:
        super().__init__()
        cell = mt.MemoryCell(
            n_inputs,
            cfg.hidden_size,
            cfg.n_slots,
            attention,
            mt.StateKeys(),
            context_size=cfg.context_size,
            output_size=cfg.n_values,
            clock=True,
        )
        cell.tune("dt", "write_gain", "key_rate")
        self.sequence = mt.MemorySequence(cell)

    def forward(self, x: Tensor) -> Tensor:
        """Outputs (T, B, values) for x (T, B, I)."""
        return self.sequence(x)[0]


RNNS: dict[str, type[nn.LSTM | nn.GRU]] = {"lstm": nn.LSTM, "gru": nn.GRU}
ATTENTIONS: dict[str, Callable[[RecallConfig], mt.Attention]] = {
    "soft": lambda cfg: mt.SoftAttention(),
    "hard": lambda cfg: mt.HardAttention(),
    "relaxed": lambda cfg: mt.RelaxedAttention(cfg.temperature),
    "reallocating": lambda cfg: mt.ReallocatingAttention("always"),
}
LONG = "_long"


def n_parameters(model: nn.Module) -> int:
    """Numbers that learning moves."""
    return sum(p.numel() for p in model.parameters() if p.requires_grad)


def build_model(cfg: RecallConfig, variant: str) -> nn.Module:
    """The cell with that attention, or the RNN with as many parameters as the cell has."""
    n_inputs = cfg.n_keys + cfg.n_values + 1
    if variant in ATTENTIONS:
        return Memory(cfg, n_inputs, ATTENTIONS[variant](cfg))
    target = n_parameters(Memory(cfg, n_inputs, mt.SoftAttention()))
    kind, size = RNNS[variant.removesuffix(LONG)], 1
    best = Recurrent(kind, n_inputs, size, cfg.n_values)
    while n_parameters(best) < target:  # the count grows with the size
        size += 1
        last, best = best, Recurrent(kind, n_inputs, size, cfg.n_values)
        if target - n_parameters(last) < n_parameters(best) - target:
            return last
    return best
