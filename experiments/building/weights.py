"""Initial weights: random draws, or a file in the golden format."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor

from mann_torch.checks import NONNEGATIVE, number
from mann_torch.control import AdaptiveNetwork, Controller
from mann_torch.errors import ConfigError, WeightsFileError
from mann_torch.trees import map_tensors

from ..runs.array_file import READ_ERRORS, ArrayFile
from ..settings.config import LoopConfig

#: Draws are numbered below this: seed and number share a generator's 64 bits.
MOST_DRAWS = 1 << 20


def check_draws(cfg: LoopConfig, draws: Sequence[int]) -> None:
    """Raise `ConfigError` for no draw, or where one (from `initial.draw` on) or the seed is off.

    So it does for `initial.std`, whether the controller has weights to draw or not.
    """
    number("initial.std", cfg.initial.std, NONNEGATIVE)
    if len(draws) < 1:
        raise ConfigError(f"draws = {len(draws)}: at least 1")
    if len(draws) > MOST_DRAWS:  # to look for the largest of them would take its time
        raise ConfigError(f"draws = {len(draws)}: at most {MOST_DRAWS}")
    first = cfg.initial.draw
    if not 0 <= first <= first + min(draws) <= first + max(draws) < MOST_DRAWS:
        raise ConfigError(
            f"initial.draw = {first}, draws {min(draws)} to {max(draws)} from there: draws must be "
            f">= 0 and < {MOST_DRAWS}"
        )
    if not 0 <= cfg.seed < 1 << 32:
        raise ConfigError(f"seed = {cfg.seed}: must be >= 0 and < 2^32")


def initial_weights(cfg: LoopConfig, controller: Controller, draws: Sequence[int]) -> Any:
    """Initial weights of draws that are counted from number `initial.draw` on, (draws, *event).

    None for a controller without. Raises `ConfigError`, for a file where it takes none too.
    """
    numbers = [cfg.initial.draw + draw for draw in draws]
    if cfg.initial.weights_file is not None:
        network = getattr(controller, "network", None)
        if not isinstance(network, AdaptiveNetwork):
            raise ConfigError("initial.weights_file: it holds weights of the paper's network alone")
        V, b_v = inner_weights(
            cfg.initial.weights_file, network.n_inputs, network.n_hidden, numbers
        )
        return network.from_inner_weights(V, b_v)
    states = []
    for draw in numbers:
        # A draw's weights depend on seed and number alone, not on how many are drawn.
        generator = torch.Generator().manual_seed((cfg.seed << 20) + draw)
        states.append(controller.initial_weights((), generator))
    return map_tensors(lambda *leaf: torch.stack(leaf), *states)


def inner_weights(
    path: str, n_inputs: int, n_hidden: int, numbers: Sequence[int]
) -> tuple[Tensor, Tensor]:
    """V (draws, I, N) and b_v (draws, N) from `V_<N>` and `b_v_<N>` of an .npz file.

    The first axis is the draw, numbered from 0 or, where the file has them, by the whole numbers
    in `draws`; inputs are ordered [e de s ds dds]. No more is unpacked than the draws asked for
    need. Raises `WeightsFileError` for a file that is missing, unreadable, of the wrong shape, not
    finite, or without a draw asked for.
    """
    if not Path(path).is_file():
        raise WeightsFileError(f"weights file '{path}' does not exist")
    names = (f"V_{n_hidden}", f"b_v_{n_hidden}")
    try:
        with ArrayFile(Path(path)) as file:
            for name in names:
                if name not in file.shapes:
                    raise WeightsFileError(
                        f"weights file '{path}' has no '{name}'; it holds "
                        f"{', '.join(sorted(file.shapes))}"
                    )
            V_shape, b_v_shape = (file.shapes[name] for name in names)
            if len(V_shape) != 3 or V_shape[1:] != (n_inputs, n_hidden):
                raise WeightsFileError(
                    f"weights file '{path}': {names[0]} has shape {V_shape}, "
                    f"not (draws, {n_inputs}, {n_hidden})"
                )
            count = V_shape[0]
            if b_v_shape != (count, n_hidden):
                raise WeightsFileError(
                    f"weights file '{path}': {names[1]} has shape {b_v_shape}, "
                    f"not {(count, n_hidden)}"
                )
            if count > MOST_DRAWS:
                raise WeightsFileError(
                    f"weights file '{path}': {count} draws are more than {MOST_DRAWS}"
                )
            rows = _rows(path, file, count, numbers)
            V, b_v = (file.rows(name, rows) for name in names)
    except WeightsFileError:
        raise
    except READ_ERRORS as error:
        cause = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise WeightsFileError(f"weights file '{path}' cannot be read: {cause}") from None
    if not (np.isfinite(V).all() and np.isfinite(b_v).all()):
        raise WeightsFileError(f"weights file '{path}': not all numbers are finite")
    return torch.from_numpy(V), torch.from_numpy(b_v)


def _rows(path: str, file: ArrayFile, count: int, asked: Sequence[int]) -> list[int]:
    """Where the draws asked for stand in the file."""
    if "draws" not in file.shapes:
        held = {number: number for number in range(count)}
    elif file.shapes["draws"] != (count,) or file.kind("draws") not in "iu":
        raise WeightsFileError(f"weights file '{path}': draws is not {count} whole numbers")
    else:
        numbers = file.rows("draws", range(count), dtype=np.int64)
        held = {int(number): row for row, number in enumerate(numbers)}
    if len(held) < count:
        raise WeightsFileError(f"weights file '{path}': draws has a number twice")
    if not set(asked) <= set(held):
        names = f"{min(held, default=0)} to {max(held, default=-1)}"
        if len(held) and max(held) - min(held) + 1 > len(held):
            names = ", ".join(map(str, sorted(held)))
        raise WeightsFileError(
            f"weights file '{path}' holds draws {names}; draws {asked[0]} to {asked[-1]} "
            "were asked for (initial.draw, draws)"
        )
    return [held[draw] for draw in asked]
