"""Every model by name, each with as many parameters as the memory."""

from __future__ import annotations

import torch
from torch import nn

from ..sequence_tasks.task import Task
from ..settings.peers_config import PeersConfig
from .attention import HEADS, CausalAttention
from .memory import MEMORIES, Memory, build_cell
from .recurrent import Recurrent
from .titans import Titans

RNNS: dict[str, type[nn.LSTM | nn.GRU]] = {"lstm": nn.LSTM, "gru": nn.GRU}
#: What a size must be a multiple of, where not of 1.
STEPS = {"attention": HEADS}


def n_parameters(model: nn.Module) -> int:
    """Numbers that learning moves."""
    return sum(p.numel() for p in model.parameters() if p.requires_grad)


def sized(cfg: PeersConfig, task: Task, variant: str, size: int) -> nn.Module:
    """A model of that width."""
    n_inputs, out = task.n_inputs, task.n_outputs
    if variant in MEMORIES:
        return Memory(build_cell(cfg, variant, n_inputs, size, out))
    if variant in RNNS:
        return Recurrent(RNNS[variant], n_inputs, size, out)
    return {"attention": CausalAttention, "titans": Titans}[variant](n_inputs, size, out)


def matched_size(cfg: PeersConfig, task: Task, variant: str) -> int:
    """The width that makes as many parameters as `memory` has, as near as can be."""
    if variant == "memory":
        return cfg.hidden_size
    target = n_parameters(sized(cfg, task, "memory", cfg.hidden_size))
    step = STEPS.get(variant, 1)
    last, size = step, step
    while (count := n_parameters(sized(cfg, task, variant, size))) < target:  # it grows
        last, size, below = size, size + step, count
    if size == step or count - target <= target - below:
        return size
    return last


def build_model(cfg: PeersConfig, task: Task, variant: str, seed: int) -> nn.Module:
    """The model of a variant, its first weights drawn from `seed`."""
    size = matched_size(cfg, task, variant)
    torch.manual_seed(seed)
    return sized(cfg, task, variant, size)
