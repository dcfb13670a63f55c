"""Check against the golden numbers of an independent simulator."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from mann_torch.errors import ConfigError

from ..runs.writing import aligned
from ..settings.config import ReproduceConfig
from ..settings.machine import check_file
from .results import Results

#: Largest deviation allowed [%]: single runs, and means over draws where runs may branch.
SINGLE, SINGLE_SWITCHING, MEAN = 1.5, 3.0, 1.5
#: At dt <= 1 ms the smooth controllers agree more closely [%].
FINE_DT, FINE = 1e-3, 0.3
SMOOTH = ("nn", "soft")


@dataclass(frozen=True)
class GoldenFile:
    """SRMSE x 10^3 [joint 1, joint 2, joint 1 t > 10 s, joint 2 t > 10 s] by run and draw."""

    path: Path
    runs: dict[tuple[str, str], dict[int, np.ndarray]]  # (scenario, variant) -> draw -> (4,)


@dataclass(frozen=True)
class Check:
    """One variant in one scenario against the golden numbers."""

    scenario: str
    variant: str
    single: float  # largest deviation of a single draw's figure [%]
    mean: float  # largest deviation of a figure's mean over draws [%]
    allowed: float
    allowed_mean: float

    @property
    def passed(self) -> bool:
        """Whether both deviations are allowed."""
        return self.single <= self.allowed and self.mean <= self.allowed_mean


def golden_file(cfg: ReproduceConfig) -> GoldenFile | None:
    """The golden numbers to check: `golden.srmse_file`, or `srmse.json` beside the weights file.

    None where neither is given. Raises `ConfigError` for an unreadable file.
    """
    if cfg.initial.weights_file is None:
        if cfg.golden.srmse_file is not None:
            raise ConfigError("golden.srmse_file: give initial.weights_file with it")
        return None
    beside = Path(cfg.initial.weights_file).parent / "srmse.json"
    path = Path(cfg.golden.srmse_file) if cfg.golden.srmse_file else beside
    if cfg.golden.srmse_file is None and not path.exists():
        return None
    check_file("golden file", path)
    try:
        scenarios: dict[str, Any] = json.loads(path.read_text())["scenarios"]
        runs = {
            (scenario, variant): {int(draw): _figures(draws[draw]) for draw in draws}
            for scenario, variants in scenarios.items()
            for variant, draws in variants.items()
        }
    except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
        raise ConfigError(f"golden file '{path}' cannot be read: {error}") from None
    held = sorted(set().union(*runs.values()))
    if not set(held) & set(_asked(cfg)):
        first, last = _asked(cfg)[0], _asked(cfg)[-1]
        raise ConfigError(
            f"golden file '{path}' has no draw {first} to {last} (initial.draw, draws); "
            f"it has {'draws ' + ', '.join(map(str, held)) if held else 'none'}"
        )
    return GoldenFile(path, runs)


def _asked(cfg: ReproduceConfig) -> range:
    return range(cfg.initial.draw, cfg.initial.draw + max(cfg.draws, 1))


def _figures(run: dict[str, Any]) -> np.ndarray:
    figures = np.array(run["srmse"], dtype=np.float64)
    if figures.shape != (4,):
        raise ValueError(f"srmse = {run['srmse']}: not four numbers")
    return figures


def checks(golden: GoldenFile, results: Results, cfg: ReproduceConfig) -> list[Check]:
    """Every golden run that was simulated, over the draws that both have."""
    found = []
    for (scenario, variant), known in golden.runs.items():
        rows = [row for row, draw in enumerate(_asked(cfg)) if draw in known]
        if not results.has(scenario, variant) or not rows:
            continue
        expected = np.array([known[cfg.initial.draw + row] for row in rows])
        ours = np.concatenate(
            [results.srmse(scenario, variant, m) for m in ("srmse", "srmse_after_10s")], axis=1
        )[rows]
        single = float(np.abs(100 * (ours / expected - 1)).max())
        mean = float(np.abs(100 * (ours.mean(axis=0) / expected.mean(axis=0) - 1)).max())
        allowed = SINGLE_SWITCHING if variant.startswith("reallocating") else SINGLE
        if variant in SMOOTH and cfg.solver.dt <= FINE_DT:
            allowed = FINE
        mean_allowed = allowed if len(expected) == 1 else min(allowed, MEAN)
        found.append(Check(scenario, variant, single, mean, allowed, mean_allowed))
    return found


def markdown(found: list[Check], path: Path) -> str:
    """The check as a Markdown section."""
    body = [["scenario", "controller", "largest single", "allowed", "largest mean", "allowed", ""]]
    for c in found:
        body.append(
            [
                c.scenario,
                c.variant,
                f"{c.single:.2f} %",
                f"{c.allowed:g} %",
                f"{c.mean:.2f} %",
                f"{c.allowed_mean:g} %",
                "ok" if c.passed else "OFF",
            ]
        )
    passed = sum(c.passed for c in found)
    head = f"### Golden numbers ({path})\n\n{passed} of {len(found)} runs agree.\n\n"
    return head + aligned(body)
