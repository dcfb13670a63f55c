"""Whether tuning and judging fit the machine, told before anything runs."""

from __future__ import annotations

from mann_torch.tuning import Tuner

from ..building.sizes import check_rollouts
from ..settings.checks import check_between
from ..settings.study_config import TuneConfig

MOST_ITERATIONS = 10**6


def check_sizes(cfg: TuneConfig, tuner: Tuner, candidates: int) -> None:
    """Raise `ConfigError` for more iterations, pairs, candidates or draws than there is room for.

    `candidates` are judged side by side, each on all held-out draws of a scenario.
    """
    check_between(cfg.schedule, {"iterations": (1, MOST_ITERATIONS)}, "schedule.")
    members = min(len(tuner.ensemble), tuner.schedule.minibatch or len(tuner.ensemble))
    copies = members * tuner.gradient.copies_for(members, tuner.coordinates.size)
    plant = tuner.ensemble.loop.plant
    check_rollouts(f"gradient.pairs = {cfg.gradient.pairs}", cfg, plant, copies)
    if cfg.judge:
        draws = len(cfg.held_out.draws)
        what = f"grid and held_out.draws, {candidates} x {draws}"
        check_rollouts(what, cfg, plant, candidates * draws)
