"""A tuning run as a page."""

from __future__ import annotations

from collections.abc import Sequence

import torch

from mann_torch.tuning import Tuner

from ..runs.intervals import Interval
from .held_out import Verdict, markdown


def signals_of(tuner: Tuner) -> dict[str, Interval]:
    """Each coordinate's mean gradient over the first quarter of the run."""
    found = tuner.signal()
    columns = zip(tuner.coordinates.labels, found.mean.tolist(), found.half.tolist(), strict=True)
    return {label: Interval(mean, half) for label, mean, half in columns}


def report_of(tuner: Tuner, verdicts: Sequence[Verdict], command: str, tuning_s: float) -> str:
    """The page: constants, what told the tuner where to go, the judgement held out."""
    n = len(tuner.history)
    z = torch.zeros_like(tuner.z) if tuner.begin is None else tuner.begin
    begun, signals = tuner.coordinates.values(z), signals_of(tuner)
    lines = [
        f"# Tuned constants\n\n{n} iterations, {tuning_s:.0f} s. Made by `{command}`.\n",
        "| constant | start | begun at | tuned | gradient, first quarter |",
        "|---|---|---|---|---|",
    ]
    for name, value in tuner.values().items():
        start = tuner.coordinates.starts()[name]
        parts = [s for label, s in signals.items() if label.split("[")[0] == name]
        told = ", ".join(f"{s.mean:+.4f} ± {s.half:.4f}" for s in parts)
        lines.append(
            f"| {name} | {_text(start)} | {_text(begun[name])} | {_text(value)} | {told} |"
        )
    quiet = tuner.silent()
    if tuner.schedule.optimizer == "optuna":
        lines.append("\nA search without gradients: nothing says which constants mattered.")
    elif quiet:
        lines.append(
            f"\n**No signal: {', '.join(quiet)}.** The gradient was 0, or its 95 % interval "
            "contains 0, over the first quarter and the whole run: where these ended is chance."
        )
    if verdicts:
        lines.append("\n## Held out\n\nPaired change from the start, mean and 95 % interval.\n")
        lines.append(markdown(verdicts))
    return "\n".join(lines) + "\n"


def _text(value: torch.Tensor) -> str:
    if value.dim() == 0:
        return f"{float(value):.4g}"
    if value.dim() == 1:
        return "[" + ", ".join(f"{x:.4g}" for x in value.tolist()) + "]"
    if bool((value == value[0, 0] * torch.eye(len(value), dtype=value.dtype)).all()):
        return f"{float(value[0, 0]):.4g} I"
    return (
        "[" + ", ".join("[" + ", ".join(f"{x:.4g}" for x in r) + "]" for r in value.tolist()) + "]"
    )
