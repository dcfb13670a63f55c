"""The wheel installs only `mann_torch`, and its commands run from anywhere."""

import email
import os
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

from mann_torch.version import __version__
from tests.away import AWAY, NEEDS_CHECKOUT

ROOT = Path(__file__).parent.parent


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the wheel alone, none of the checkout."""
    base = tmp_path_factory.mktemp("wheel")
    source = base / "source"
    files = subprocess.run(
        ["git", "ls-files", "-co", "--exclude-standard"], cwd=ROOT, capture_output=True, text=True
    ).stdout.split()
    for name in files:
        if (ROOT / name).exists() and not name.startswith(("tests/", "logs/")):
            (source / name).parent.mkdir(parents=True, exist_ok=True)
            (source / name).write_bytes((ROOT / name).read_bytes())
    pip = [sys.executable, "-m", "pip", "install", "--quiet", "--no-deps", "--no-build-isolation"]
    subprocess.run([*pip, "--target", str(base / "site"), str(source)], check=True)
    return base / "site"


def test_every_package_is_shipped() -> None:
    settings = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["setuptools"]
    found = {
        ".".join(place.parent.relative_to(ROOT).parts)
        for name in ("mann_torch", "experiments", "conf")
        for place in (ROOT / name).rglob("__init__.py")
    }
    inside = {n if n.startswith("mann_torch") else f"mann_torch.{n}" for n in found}
    assert inside == set(settings["packages"])


def test_no_foreign_top_level_names(site: Path) -> None:
    names = {p.name for p in site.iterdir() if not p.name.endswith(".dist-info")}
    assert names == {"mann_torch", "bin"}
    assert (site / "mann_torch" / "conf" / "scenario" / "1.yaml").exists()


def test_the_console_script_runs_from_another_folder(site: Path, tmp_path: Path) -> None:
    environment = {**os.environ, "PYTHONPATH": str(site), "PYTHONSAFEPATH": "1"}
    script = site / "bin" / "mann-simulate"
    arguments = ["controller=nn", "horizon=0.05", "output.tensorboard=false"]
    where = "import mann_torch.experiments.simulate as s; print(s.__file__)"
    found = subprocess.run(
        [sys.executable, "-c", where], cwd=tmp_path, env=environment, capture_output=True, text=True
    )
    assert found.stdout.startswith(str(site)), found.stderr
    done = subprocess.run(
        [str(script), *arguments], cwd=tmp_path, env=environment, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr
    assert len(list((tmp_path / "logs" / "simulate").glob("*/metrics.json"))) == 1


def test_its_metadata_say_version_and_pythons_and_its_types_are_shipped(site: Path) -> None:
    (told,) = site.glob("mann_torch-*.dist-info/METADATA")
    metadata = email.message_from_string(told.read_text())
    assert metadata["Version"] == __version__
    assert metadata["Requires-Python"] == ">=3.11"
    assert (site / "mann_torch" / "py.typed").exists()


@pytest.mark.slow
def test_an_installed_library_checks_itself_from_another_folder(site: Path, tmp_path: Path) -> None:
    environment = {**os.environ, "PYTHONPATH": str(site), "PYTHONSAFEPATH": "1"}
    command = [sys.executable, "-m", "mann_torch.testing"]
    done = subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr
    assert done.stdout.startswith(f"mann_torch {__version__}, Python")


def test_what_is_left_out_away_from_the_checkout_is_here() -> None:
    assert not AWAY
    assert all((ROOT / "tests" / name).exists() for name in NEEDS_CHECKOUT)
