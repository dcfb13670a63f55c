"""What Hydra needs to know: where the files are, schemas, run folders, help texts."""

from __future__ import annotations

import datetime
import os
import secrets
from pathlib import Path

from hydra.core.config_store import ConfigStore
from omegaconf import OmegaConf

from .config import ReproduceConfig, SimulateConfig
from .memory_config import OnlineRegressionConfig, RecallConfig
from .study_config import GradientReportConfig, TuneConfig

# conf/ in a checkout, mann_torch/conf in an installed wheel: beside this package in both.
CONF = Path(__file__).resolve().parent.parent / "conf"


def _stamp() -> str:
    now = datetime.datetime.now().strftime("%Y%m%d-%H%M%S-%f")
    return f"{now}-{os.getpid()}{secrets.token_hex(2)}"


def _run_folder(run_dir: str | None, task: str) -> str:
    return run_dir or f"logs/{task}/{_stamp()}"


def _tune_folder(run_dir: str | None, resume: str | None) -> str:
    return resume or _run_folder(run_dir, "tune")


def _sweep_folder(run_dir: str | None, task: str) -> str:
    return run_dir or f"logs/{task}/multirun-{_stamp()}"


def group_names(group: str) -> list[str]:
    """The names a configuration group offers."""
    return sorted(path.stem for path in (CONF / group).glob("*.yaml"))


def _group_lines(groups: tuple[str, ...]) -> list[str]:
    return [f"  {group:<11}{', '.join(group_names(group))}" for group in groups]


def _simulate_help() -> str:
    return "\n".join(
        [
            "Simulate one scenario under one controller: SRMSE, figures, TensorBoard, arrays.",
            "",
            *_group_lines(("scenario", "controller", "keys", "solver", "plant")),
            "",
            "  example    python -m experiments.simulate scenario=5 controller=soft draws=3",
            "  sweep      python -m experiments.simulate -m scenario=1,4 controller=nn,soft",
            "",
            "Settings, each as NAME=VALUE:",
            "",
            "$CONFIG",
        ]
    )


def _reproduce_help() -> str:
    return "\n".join(
        [
            "Reproduce the paper's tables, figures and claims.",
            "",
            *_group_lines(("experiment", "solver")),
            "",
            "  one table  python -m experiments.reproduce experiment=[table_1]",
            "  golden     python -m experiments.reproduce"
            " initial.weights_file=tests/golden/initial_weights.npz",
            "",
            "Settings, each as NAME=VALUE:",
            "",
            "$CONFIG",
        ]
    )


def _tune_help() -> str:
    return "\n".join(
        [
            "Tune design constants by gradient, then judge them on scenarios and draws held out.",
            "",
            *_group_lines(("scenario", "controller", "keys", "solver")),
            "",
            "  fewer      python -m experiments.tune names=[write_gain,error_gain]",
            "  resume     python -m experiments.tune resume=logs/tune/STAMP",
            "  compare    python -m experiments.tune compare=[logs/tune/OTHER]",
            "",
            "Settings, each as NAME=VALUE:",
            "",
            "$CONFIG",
        ]
    )


def _report_help() -> str:
    return "\n".join(
        [
            "Every gradient mode against differences, constant by constant, for one scenario.",
            "",
            *_group_lines(("scenario", "controller", "keys", "solver")),
            "",
            "  example    python -m experiments.gradient_report scenario=4 controller=hard",
            "",
            "Settings, each as NAME=VALUE:",
            "",
            "$CONFIG",
        ]
    )


def register() -> None:
    """Put schemas and resolvers in Hydra's stores; safe to call again."""
    OmegaConf.register_new_resolver("run_folder", _run_folder, replace=True, use_cache=True)
    OmegaConf.register_new_resolver("sweep_folder", _sweep_folder, replace=True, use_cache=True)
    OmegaConf.register_new_resolver("tune_folder", _tune_folder, replace=True, use_cache=True)
    OmegaConf.register_new_resolver("tune_help", _tune_help, replace=True)
    OmegaConf.register_new_resolver("report_help", _report_help, replace=True)
    OmegaConf.register_new_resolver("simulate_help", _simulate_help, replace=True)
    OmegaConf.register_new_resolver("reproduce_help", _reproduce_help, replace=True)
    store = ConfigStore.instance()
    store.store(name="base_simulate", node=SimulateConfig)
    store.store(name="base_reproduce", node=ReproduceConfig)
    store.store(name="base_online_regression", node=OnlineRegressionConfig)
    store.store(name="base_recall", node=RecallConfig)
    store.store(name="base_tune", node=TuneConfig)
    store.store(name="base_gradient_report", node=GradientReportConfig)


register()
