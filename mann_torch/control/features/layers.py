"""Layers of tanh: features that were learned elsewhere, or that are to be tuned."""

from __future__ import annotations

import zipfile
import zlib
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from ...checks import several, whole, wrong
from ...constraints import FiniteRow
from ...errors import ConfigError, ShapeError
from ...functional import as_float64, times_column
from .basis import Basis

#: What a broken file makes NumPy raise.
_READ_ERRORS = (OSError, ValueError, EOFError, KeyError, zipfile.BadZipFile, zlib.error)


class Layers(Basis):
    """phi = tanh(W_k ... tanh(W_1 z + b_1) ... + b_k): one hidden layer, or more.

    Weights (N_j, N_{j-1}) and biases (N_j,), layer by layer. Constants `layer_weight_1` (its
    entries row by row), `layer_bias_1` and so on. Source of the form: Richards, Azizan, Slotine and
    Pavone, RSS 2021, arXiv 2103.04490. Raises `ShapeError`, `ConfigError`, `DomainError`,
    `KindError` or `DtypeError`.
    """

    def __init__(self, weights: Sequence[Tensor], biases: Sequence[Tensor]) -> None:
        super().__init__()
        each = several("weights", weights, Tensor), several("biases", biases, Tensor)
        if not each[0] or len(each[0]) != len(each[1]):
            raise ShapeError(f"{len(each[0])} weights and {len(each[1])} biases: one each a layer")
        self.shapes: list[tuple[int, int]] = []
        width = None
        for n, (W, b) in enumerate(zip(*each, strict=True), 1):
            if W.dim() != 2 or b.shape != W.shape[:1] or width not in (None, W.shape[1]):
                raise ShapeError(
                    f"layer {n} has weights {tuple(W.shape)} and biases {tuple(b.shape)} "
                    f"after {width or 'the input'}: give (N, {width or 'I'}) and (N,)"
                )
            width = W.shape[0]
            self.shapes.append((W.shape[0], W.shape[1]))
            self.declare(f"layer_weight_{n}", W.reshape(-1), FiniteRow(), (W.numel(),))
            self.declare(f"layer_bias_{n}", b, FiniteRow(), (len(b),))
        self.n_inputs, self.n_features = self.shapes[0][1], self.shapes[-1][0]

    @classmethod
    def random(cls, n_inputs: int, n_hidden: int, layers: int = 1, seed: int = 0) -> Layers:
        """Normal weights of variance 1/N_{j-1}, by seed; biases 0."""
        generator = torch.Generator().manual_seed(whole("seed", seed, least=0))
        widths = [whole("n_inputs", n_inputs)]
        widths += [whole("n_hidden", n_hidden)] * whole("layers", layers)
        weights = [
            torch.randn(out, into, generator=generator, dtype=torch.float64) / into**0.5
            for into, out in pairwise(widths)
        ]
        return cls(weights, [torch.zeros_like(W[:, 0]) for W in weights])

    @classmethod
    def of_file(cls, path: str) -> Layers:
        """Of W1, b1, W2, b2, ... in a .npz file. Raises `ConfigError` for one that has none."""
        if not isinstance(path, str | Path):
            raise wrong("path", path, "a path")
        try:
            with np.load(path, allow_pickle=False) as held:
                count = sum(f"W{n + 1}" in held for n in range(len(held.files)))
                pairs = [(held[f"W{n + 1}"], held[f"b{n + 1}"]) for n in range(count)]
        except _READ_ERRORS as error:
            told = str(error).splitlines()[0] if str(error) else type(error).__name__
            raise ConfigError(f"path: layers of '{path}' cannot be read: {told}") from None
        if not pairs:
            raise ConfigError(f"path: '{path}' holds no W1, b1, ...")
        rows = [[as_float64(torch.from_numpy(x).double(), "path") for x in pair] for pair in pairs]
        return cls([W for W, _ in rows], [b for _, b in rows])

    def forward(self, nn_input: Tensor) -> Tensor:
        """phi (..., N)."""
        for n, shape in enumerate(self.shapes, 1):
            W: Tensor = getattr(self, f"layer_weight_{n}")
            pre = times_column(W.unflatten(-1, shape), nn_input)
            nn_input = torch.tanh(pre + getattr(self, f"layer_bias_{n}"))
        return nn_input
