"""Where the configuration files are, and the names they offer."""

from __future__ import annotations

from pathlib import Path

# conf/ in a checkout, mann_torch/conf in an installed wheel: beside this package in both.
CONF = Path(__file__).resolve().parents[2] / "conf"


def group_names(group: str) -> list[str]:
    """The names a configuration group offers."""
    return sorted(path.stem for path in (CONF / group).glob("*.yaml"))
