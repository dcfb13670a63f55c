"""What has to be simulated for the chosen tables, figures and claims, in one batch a variant."""

from __future__ import annotations

from dataclasses import dataclass, field

from mann_torch.errors import ConfigError

from ..command.conf_files import group_names
from ..settings.config import ReproduceConfig
from .claim_runs import CLAIM_RUNS, OURS

METRICS = ("srmse", "srmse_after_10s")
PANELS = ("joint_angles", "features_and_read", "attention_timeline")


@dataclass(frozen=True)
class Job:
    """One controller variant through several scenarios, all draws."""

    variant: str
    overrides: list[str]
    scenarios: list[str]
    recorded: list[str] = field(default_factory=list)  # scenarios whose signals are kept


def plan(cfg: ReproduceConfig, golden_runs: list[tuple[str, str]]) -> list[Job]:
    """The jobs, longest first. Raises `ConfigError` for names that do not exist."""
    runs: set[tuple[str, str]] = set(golden_runs)
    recorded: set[tuple[str, str]] = set()
    for name, table in cfg.tables.items():
        _known(table.metric, METRICS, f"tables.{name}.metric")
        labels = {row.label for row in table.rows}
        pairs = {"reduction": table.reduction, "paper_reduction": table.paper_reduction}
        pairs |= {f"rows ({row.label}).paper": row.paper for row in table.rows}
        for key, pair in pairs.items():
            if pair is not None and len(pair) != 2:
                raise ConfigError(f"tables.{name}.{key} = {list(pair)}: give two")
        for label in table.reduction or []:
            _known(label, tuple(labels), f"tables.{name}.reduction")
        for row in table.rows:
            scenario = row.scenario or table.scenario
            runs |= {(scenario, row.variant), (scenario, OURS)}
    for name, figure in cfg.figures.items():
        for panel in figure.panels:
            _known(panel, PANELS, f"figures.{name}.panels")
        recorded |= {(figure.scenario, variant) for variant in figure.variants}
    if judges_claims(cfg):
        runs |= set(CLAIM_RUNS)
        recorded |= {run for run in CLAIM_RUNS if run[0] == "illustration"}
    runs |= recorded
    known = tuple(group_names("scenario"))
    for scenario, variant in sorted(runs):
        _known(variant, tuple(cfg.variants), "variants")
        _known(scenario, known, "scenario")
    jobs = []
    for variant in sorted({variant for _, variant in runs}):
        scenarios = sorted(scenario for scenario, v in runs if v == variant)
        kept = sorted(scenario for scenario, v in recorded if v == variant)
        jobs.append(Job(variant, list(cfg.variants[variant]), scenarios, kept))
    return sorted(jobs, key=lambda job: ("3" not in job.scenarios, -len(job.scenarios)))


def _known(name: str, names: tuple[str, ...], where: str) -> None:
    if name not in names:
        raise ConfigError(f"{where}: unknown name '{name}'; choose from {', '.join(names)}")


def judges_claims(cfg: ReproduceConfig) -> bool:
    """Claims are judged on whole runs only."""
    return cfg.claims and cfg.horizon is None
