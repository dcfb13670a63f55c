"""What Hydra needs to know: schemas, run folders, help texts."""

from __future__ import annotations

import datetime
import os
import secrets
from pathlib import Path

from hydra.core.config_store import ConfigStore
from omegaconf import OmegaConf

from ..settings.ablation_config import AblationConfig
from ..settings.benchmarks_config import BenchmarksConfig
from ..settings.config import ReproduceConfig, SimulateConfig
from ..settings.ensemble_config import EnsembleConfig
from ..settings.export_config import ExportConfig
from ..settings.memory_config import OnlineRegressionConfig
from ..settings.peers_config import PeersConfig
from ..settings.problem_tuning_config import ProblemTuningConfig
from ..settings.returning_config import ReturningConfig
from ..settings.study_config import GradientReportConfig, TuneConfig
from .help_texts import help_text


def _stamp() -> str:
    now = datetime.datetime.now().strftime("%Y%m%d-%H%M%S-%f")
    return f"{now}-{os.getpid()}{secrets.token_hex(2)}"


def _run_folder(run_dir: str | None, task: str) -> str:
    return run_dir or f"logs/{task}/{_stamp()}"


def _tune_folder(run_dir: str | None, resume: str | None) -> str:
    return resume or _run_folder(run_dir, "tune")


#: What a scenario sets alone: a configuration of nothing else.
ONLY_SCENARIO = "only_scenario"
#: The folder of the sweep that this process started.
swept: list[Path] = []


def _sweep_folder(run_dir: str | None, task: str) -> str:
    folder = run_dir or f"logs/{task}/multirun-{_stamp()}"
    swept[:] = [Path(folder)]
    return folder


#: Files that come with the package, for settings that name one.
DATA = Path(__file__).resolve().parents[1] / "problems" / "data"


def _data_file(name: str) -> str:
    return str(DATA / name)


def register() -> None:
    """Put schemas and resolvers in Hydra's stores; safe to call again."""
    OmegaConf.register_new_resolver("run_folder", _run_folder, replace=True, use_cache=True)
    OmegaConf.register_new_resolver("sweep_folder", _sweep_folder, replace=True, use_cache=True)
    OmegaConf.register_new_resolver("tune_folder", _tune_folder, replace=True, use_cache=True)
    OmegaConf.register_new_resolver("data_file", _data_file, replace=True)
    OmegaConf.register_new_resolver("help_text", help_text, replace=True)
    store = ConfigStore.instance()
    store.store(name="base_simulate", node=SimulateConfig)
    store.store(name=ONLY_SCENARIO, node={"defaults": [{"scenario": "plain"}]})
    store.store(name="base_reproduce", node=ReproduceConfig)
    store.store(name="base_online_regression", node=OnlineRegressionConfig)
    store.store(name="base_ensemble", node=EnsembleConfig)
    store.store(name="base_export", node=ExportConfig)
    store.store(name="base_peers", node=PeersConfig)
    store.store(name="base_ablation", node=AblationConfig)
    store.store(name="base_tune", node=TuneConfig)
    store.store(name="base_benchmarks", node=BenchmarksConfig)
    store.store(name="base_tune_problems", node=ProblemTuningConfig)
    store.store(name="base_returning", node=ReturningConfig)
    store.store(name="base_gradient_report", node=GradientReportConfig)
