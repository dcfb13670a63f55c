"""The augmented error."""

from __future__ import annotations

from .learned_deficit import LearnedDeficit


class AugmentedError(LearnedDeficit):
    """The error that adapts is x_m + e_d - x, less what the limits did; u is as it is.

    Arguments, constants and errors are those of `LearnedDeficit`. Karason and Annaswamy 1994,
    Adaptive control in the presence of input constraints.
    """
