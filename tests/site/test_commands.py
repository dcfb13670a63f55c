"""Every command that a page shows exists, and its settings compose and are accepted."""

import functools
import importlib.util
import re
import shlex
import tomllib

import pytest

from experiments.command.cli import compose_job
from experiments.command.overrides import jobs_of, opened, quote_numeric_names
from experiments.command.unused import Typed
from mann_torch.errors import ConfigError
from tests.site.pages import ROOT, shell_lines

PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
EXTRAS = PROJECT["optional-dependencies"]
#: Settings whose packages and folders are not here, and options that only ask.
ELSEWHERE = re.compile(r"--config-dir|my_package|resume=|export\.tuned=")
NOT_HERE = re.compile(r"hydra/launcher=|hydra\.launcher\.|--help$|-sc$|install=\w+$")
#: Commands of other people that pages show.
KNOWN = {"tensorboard", "cd", "git", "source", "colcon", "ros2", "export", "cmake", "cc", "open"}


def check(words: list[str]) -> None:
    """Fail unless a command exists and takes what it is given."""
    if words[0] == "eval":
        words = re.sub(r"^\$\(|\)$", "", words[1]).split()
    first, *rest = words
    if first == "make":
        check_make(rest)
    elif first == "pip":
        check_pip(rest)
    elif first == "python" and rest[0] == "-m":
        check_module(rest[1], rest[2:])
    elif first.startswith("mann-"):
        place, _, function = PROJECT["scripts"][first].removeprefix("mann_torch.").partition(":")
        check_module(f"experiments.{function}" if place.endswith(".early") else place, rest)
    else:
        assert first in KNOWN, f"no such command: {first}"


def check_make(words: list[str]) -> None:
    """A target of the Makefile, and the settings in its ARGS."""
    settings = [word for word in words if "=" in word]
    (target,) = (word for word in words if "=" not in word)
    assert re.search(rf"^{target}:", (ROOT / "Makefile").read_text(), re.M), target
    for setting in settings:
        name, _, value = setting.partition("=")
        assert name in ("ARGS", "PYTHON"), name
        if name == "ARGS" and target in ("reproduce", "benchmarks"):
            check_module(f"experiments.{target}", value.split())


def check_pip(words: list[str]) -> None:
    """What pip installs is this package, and it has these extras."""
    assert words[0] in ("install", "wheel"), words
    for names in re.findall(r"\[([\w,]+)\]", " ".join(words)):
        assert set(names.split(",")) <= set(EXTRAS), names


def check_module(name: str, words: list[str]) -> None:
    """A module with a `main`, and what follows as its settings."""
    if not name.startswith("experiments."):
        assert importlib.util.find_spec(name) is not None, name
        return
    module = importlib.import_module(name)
    if not hasattr(module, "checked"):
        source = (ROOT / f"{name.replace('.', '/')}.py").read_text()
        options = [word.partition("=")[0] for word in words if word.startswith("--")]
        assert all(f'"{option}"' in source for option in options), options
        return
    jobs = list(jobs_of(quote_numeric_names([w for w in words if not NOT_HERE.match(w)])))
    compose = functools.partial(compose_job, name.rpartition(".")[2])
    jobs = [opened(job) for job in jobs[:: max(1, len(jobs) - 1)]]  # the first and the last
    composed = [compose(job) for job in jobs]
    for cfg in composed:
        module.checked(cfg)
    if hasattr(module, "what_runs"):
        Typed(jobs, composed, compose, module.what_runs).check_used(module.LOOP_NODES)


@pytest.mark.parametrize("line", shell_lines())
def test_a_command_that_is_shown_is_accepted(line: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(ROOT)  # some name a file of it
    words = shell_lines()[line]
    if ELSEWHERE.search(line):
        words = [word for word in words if "=" not in word and not word.startswith("--")]
    check(words)


def test_commands_are_those_that_a_wheel_has() -> None:
    """Not everybody has a checkout: what a wheel brings is called as it brings it."""
    modules = (words[2] for words in shell_lines().values() if words[:2] == ["python", "-m"])
    names = [name.partition(".")[2].replace("_", "-") for name in modules if "experiments" in name]
    assert not {f"mann-{name}" for name in names} & set(PROJECT["scripts"])


@pytest.mark.parametrize(
    "line",
    [
        "python -m experiments.nothing",
        "python -m experiments.simulate horizn=3",
        "python -m experiments.simulate controller=nn memory.reset=raw",
        "make nothing",
        'make reproduce ARGS="drawss=3"',
        "pip install mann_torch[nothing]",
        "mann-nothing",
        "nothing",
    ],
)
def test_a_command_that_does_not_exist_is_found(line: str) -> None:
    with pytest.raises((AssertionError, ImportError, KeyError, ConfigError)):
        check(shlex.split(line))
