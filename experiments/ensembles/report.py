"""What one or several ensembles leave behind: rollouts, summary, histogram."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from ..runs.pictures import linked, save_all
from ..runs.writing import write_text
from ..settings.config import PicturesConfig
from .histogram import histogram
from .rollouts import ROLLOUTS, Rollouts, text_of
from .summary import ranges, table, worst_table

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass(frozen=True)
class Told:
    """An ensemble with what its page says of it."""

    rollouts: Rollouts
    title: str
    alone: str  # the command that runs one of its rollouts, to be followed by overrides
    draw: int  # of the initial weights of rollout 0


def write_ensembles(
    folder: Path,
    ensembles: Mapping[str, Told],
    command: str,
    note: str = "",
    output: PicturesConfig | None = None,
) -> dict[str, Figure]:
    """`rollouts.csv`, `ensemble.md`, `histogram.png`; the names say which ensemble is which.

    Returns the pictures by name.
    """
    output = output or PicturesConfig()
    rollouts = {name: told.rollouts for name, told in ensembles.items()}
    write_text(folder / ROLLOUTS, text_of(rollouts))
    page = [f"`{command}`", *(_section(name, told) for name, told in ensembles.items())]
    page += [note] if note else []
    figures = {}
    if output.figures:
        titles = {told.title for told in ensembles.values()}
        title = titles.pop() if len(titles) == 1 else f"{len(ensembles)} ensembles"
        figures["histogram"] = histogram(rollouts, title)
    save_all(folder, figures, output)
    write_text(folder / "ensemble.md", "\n\n".join(page) + "\n" + linked(figures, output))
    return figures


def _section(name: str, told: Told) -> str:
    rollouts = told.rollouts
    lost = len(rollouts) - int(rollouts.ok.sum())
    parts = [f"## {name}"] if name else []
    parts += [
        f"{told.title}: {len(rollouts)} rollouts, {ranges(rollouts.number)}; {lost} diverged. "
        "Means with 95 % intervals, and quantiles, over those that did not.",
        table(rollouts),
        f"The worst. To run one of them alone: `{told.alone}` and its overrides.",
        worst_table(rollouts, told.draw),
    ]
    return "\n\n".join(parts)
