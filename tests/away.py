"""The tests of an installed wheel, from a folder where no checkout is (`make wheel`)."""

from __future__ import annotations

import importlib
import sys
from importlib.machinery import ModuleSpec
from importlib.util import spec_from_loader
from pathlib import Path
from types import ModuleType

ROOT = Path(__file__).parent.parent
#: Whether the library that is tested is an installed one.
AWAY = not (ROOT / "pyproject.toml").exists()
#: What reads sources, pages or settings of the checkout, or runs `python -m experiments`.
NEEDS_CHECKOUT = (
    "pages.py",
    "site",
    "test_compiling_page.py",
    "test_deploy_page.py",
    "test_gallery.py",
    "test_layers.py",
    "test_packaging.py",
    "test_readme.py",
    "test_tuning_pages.py",
    "test_versions.py",
    "deployment/test_ros2_page.py",
    "experiments/test_ensemble.py",
    "experiments/test_export.py",
    "experiments/test_invalid_settings.py",
    "experiments/test_life.py",
    "experiments/test_own_package.py",
    "experiments/test_simulate_cli.py",
    "experiments/test_sweeps.py",
    "experiments/test_tune_cli.py",
    "experiments/test_workers.py",
    "memory/test_in_gymnasium.py",
    "simulation/problems/test_quadrotor_in_wind.py",
    "simulation/test_own_parts.py",
    "simulators/test_simulators_page.py",
)


class Installed:
    """Finds `experiments` where a wheel has it: in `mann_torch.experiments`."""

    def find_spec(self, name: str, path: object = None, target: object = None) -> ModuleSpec | None:
        """A spec of the installed module, for what is called as in the checkout."""
        return spec_from_loader(name, self) if name.split(".")[0] == "experiments" else None

    def create_module(self, spec: ModuleSpec) -> ModuleType:
        """The installed module itself."""
        return importlib.import_module(f"mann_torch.{spec.name}")

    def exec_module(self, module: ModuleType) -> None:
        """Nothing is left to do."""


if AWAY:
    sys.meta_path.insert(0, Installed())  # type: ignore[arg-type]
