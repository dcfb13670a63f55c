"""Every command that the README and the docs show is accepted."""

import importlib
import re
import shlex
from pathlib import Path

import pytest

from experiments.command.cli import compose_job
from experiments.command.overrides import jobs_of, quote_numeric_names

ROOT = Path(__file__).parents[2]
PAGES = (ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md")))
#: Options and folders that are not here.
ELSEWHERE = ("--config-dir", "--help", "-sc", "STAMP", "OTHER", "my_package", "FOLDER", "launcher")
LINES = dict.fromkeys(
    line.partition(" #")[0].strip()
    for page in PAGES
    for block in re.findall(r"```sh\n(.*?)```", page.read_text(), re.S)
    for line in block.splitlines()
    if re.match(
        r"python -m experiments\.(simulate|ensemble|export|tune|gradient_report|benchmarks)\b", line
    )
)


@pytest.mark.parametrize(
    "line", [line for line in LINES if not any(word in line for word in ELSEWHERE)]
)
def test_a_command_that_is_shown_is_accepted(line: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(ROOT)  # some name a file of it
    command, *arguments = shlex.split(line)[2:]
    module = importlib.import_module(command)
    for overrides in jobs_of(quote_numeric_names(arguments)):
        module.checked(compose_job(command.rpartition(".")[2], overrides))
