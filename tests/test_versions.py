"""The version is said once, and whoever repeats it says the same."""

import re
import tomllib
from pathlib import Path

import yaml

import mann_torch as mt
from mann_torch.version import __version__

ROOT = Path(__file__).parent.parent
CHANGES = (ROOT / "CHANGELOG.md").read_text()


def test_the_project_takes_its_version_from_the_library() -> None:
    settings = tomllib.loads((ROOT / "pyproject.toml").read_text())
    assert "version" in settings["project"]["dynamic"] and "version" not in settings["project"]
    found = settings["tool"]["setuptools"]["dynamic"]["version"]["attr"]
    assert found == "mann_torch.version.__version__" and mt.__version__ == __version__


def test_the_citation_has_the_versions_number_and_date() -> None:
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text())
    assert citation["version"] == __version__
    assert f"## [{__version__}] - {citation['date-released']}" in CHANGES


def test_the_changelog_goes_back_from_the_newest_version() -> None:
    headings = re.findall(r"^## \[(.+?)\](?: - (\d{4}-\d\d-\d\d))?$", CHANGES, re.M)
    assert headings[0] == ("Unreleased", "")
    released = [(tuple(map(int, version.split("."))), day) for version, day in headings[1:]]
    assert released == sorted(released, reverse=True) and len(released) >= 2
    kinds = set(re.findall(r"^### (.+)$", CHANGES, re.M))
    assert kinds <= {"Added", "Changed", "Deprecated", "Removed", "Fixed", "Security"}


def test_readme_names_every_extra() -> None:
    extras = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    readme = (ROOT / "README.md").read_text()
    for name in extras["optional-dependencies"]:
        assert f"`{name}`" in readme, name
