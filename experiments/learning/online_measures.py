"""What a pass over a stream of returning functions measures."""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor

from ..settings.memory_config import OnlineRegressionConfig
from .report import Measure

#: An error this many times the functions' RMS counts as diverged.
LIMIT = 1e3
MEASURES = (
    Measure("after_switch", "RMSE after a switch", 3),
    Measure("steady", "RMSE, steady", 3),
    Measure("recovered", "recovered", 2, lower_is_better=False),
    Measure("recovery_s", "recovery [s]", 2),
    Measure("before_return", "RMSE before return", 3),
    Measure("at_leaving", "RMSE when left", 3),
)


def measured(
    cfg: OnlineRegressionConfig, squared: Tensor, probed: Tensor, rms: Tensor
) -> dict[str, np.ndarray]:
    """Measures (B,) by name, over the visits that are returns; NaN for a seed that diverged.

    `squared` (visits, samples, B) are squared errors in order of the stream, `probed` (visits, K,
    B) the RMSE on each function after each visit, `rms` (K, B) the functions' own RMS. A seed that
    never recovers in a visit counts with the visit's length.
    """
    K, window = cfg.n_functions, round(cfg.window / cfg.dt)
    back, half = squared[K:], window // 2
    returns = range(K, len(squared))
    pieces = back[:, : back.shape[1] // half * half].unflatten(1, (-1, half)).mean(dim=2).sqrt()
    good = pieces < 0.5 * rms[[v % K for v in returns]].unsqueeze(1)
    first = torch.where(good.any(dim=1), good.int().argmax(dim=1), good.shape[1])
    found = {
        "after_switch": back[:, :window].mean(dim=1).sqrt().mean(dim=0),
        "steady": back[:, -2 * window :].mean(dim=1).sqrt().mean(dim=0),
        "recovered": good.any(dim=1).double().mean(dim=0),
        "recovery_s": first.double().mean(dim=0) * half * cfg.dt,
        "before_return": torch.stack([probed[v - 1, v % K] for v in returns]).mean(dim=0),
        "at_leaving": torch.stack([probed[v - K, v % K] for v in returns]).mean(dim=0),
    }
    worst = torch.maximum(squared.amax(dim=(0, 1)).sqrt(), probed.amax(dim=(0, 1)))
    fine = worst < LIMIT * rms.mean(dim=0)  # False for NaN
    return {name: torch.where(fine, value, torch.nan).numpy() for name, value in found.items()}


def after_each_switch(cfg: OnlineRegressionConfig, squared: Tensor) -> np.ndarray:
    """RMSE (visits, B) over the window at the start of each visit."""
    return squared[:, : round(cfg.window / cfg.dt)].mean(dim=1).sqrt().numpy()


def in_blocks(rmse: np.ndarray, block: int) -> np.ndarray:
    """RMSE (visits, samples) over `block` samples each, as one row."""
    whole = rmse.size // block * block
    blocks: np.ndarray = np.sqrt((rmse.reshape(-1)[:whole].reshape(-1, block) ** 2).mean(axis=1))
    return blocks
