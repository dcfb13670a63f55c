"""Initial weights: random draws, or a file in the golden format."""

from __future__ import annotations

import zipfile
import zlib
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from mann_torch import MannController
from mann_torch.errors import ConfigError, WeightsFileError
from mann_torch.types import NetworkState

from ..settings.config import SimulateConfig


def initial_network(cfg: SimulateConfig, controller: MannController) -> NetworkState:
    """Initial weights of `draws` draws from number `initial.draw` on, (draws, *event)."""
    first, network = cfg.initial.draw, controller.network
    if not 0 <= first <= first + cfg.draws < 1 << 20:
        raise ConfigError(f"initial.draw = {first}, draws = {cfg.draws}: must be >= 0 and < 2^20")
    if not 0 <= cfg.seed < 1 << 32:
        raise ConfigError(f"seed = {cfg.seed}: must be >= 0 and < 2^32")
    if cfg.initial.weights_file is not None:
        V, b_v = inner_weights(
            cfg.initial.weights_file, network.n_inputs, network.n_hidden, first, cfg.draws
        )
        return network.from_inner_weights(V, b_v)
    states = []
    for draw in range(first, first + cfg.draws):
        # A draw's weights depend on seed and number alone, not on how many are drawn.
        generator = torch.Generator().manual_seed((cfg.seed << 20) + draw)
        states.append(network.initial_state((), generator))
    return NetworkState(*(torch.stack(leaf) for leaf in zip(*states, strict=True)))


def inner_weights(
    path: str, n_inputs: int, n_hidden: int, first: int, draws: int
) -> tuple[Tensor, Tensor]:
    """V (draws, I, N) and b_v (draws, N) from `V_<N>` and `b_v_<N>` of an .npz file.

    The first axis is the draw, numbered from 0 or, where the file has them, by the whole numbers
    in `draws`; inputs are ordered [e de s ds dds]. Raises `WeightsFileError` for a file that is
    missing, unreadable, of the wrong shape, not finite, or without a draw asked for.
    """
    file = Path(path)
    if not file.is_file():
        raise WeightsFileError(f"weights file '{path}' does not exist")
    names = (f"V_{n_hidden}", f"b_v_{n_hidden}")
    arrays, numbers = [], None
    try:
        with np.load(file, allow_pickle=False) as data:
            for name in names:
                if name not in data.files:
                    raise WeightsFileError(
                        f"weights file '{path}' has no '{name}'; it holds {', '.join(data.files)}"
                    )
                arrays.append(np.asarray(data[name], dtype=np.float64))
            if "draws" in data.files:
                numbers = np.asarray(data["draws"])
    except WeightsFileError:
        raise
    except (
        OSError,
        ValueError,
        EOFError,
        KeyError,
        zipfile.BadZipFile,
        zlib.error,
        AttributeError,
        TypeError,
    ) as error:
        cause = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise WeightsFileError(f"weights file '{path}' cannot be read: {cause}") from None
    V, b_v = arrays
    if V.ndim != 3 or V.shape[1:] != (n_inputs, n_hidden):
        raise WeightsFileError(
            f"weights file '{path}': {names[0]} has shape {V.shape}, "
            f"not (draws, {n_inputs}, {n_hidden})"
        )
    if b_v.shape != (V.shape[0], n_hidden):
        raise WeightsFileError(
            f"weights file '{path}': {names[1]} has shape {b_v.shape}, not {(len(V), n_hidden)}"
        )
    if not (np.isfinite(V).all() and np.isfinite(b_v).all()):
        raise WeightsFileError(f"weights file '{path}': not all numbers are finite")
    rows = _rows(path, numbers, len(V), range(first, first + draws))
    return torch.from_numpy(V[rows]), torch.from_numpy(b_v[rows])


def _rows(path: str, numbers: np.ndarray | None, count: int, asked: range) -> list[int]:
    """Where the draws asked for stand in the file."""
    if numbers is None:
        numbers = np.arange(count)
    elif numbers.shape != (count,) or numbers.dtype.kind not in "iu":
        raise WeightsFileError(f"weights file '{path}': draws is not {count} whole numbers")
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
