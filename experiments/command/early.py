"""What a command does before torch is imported: --help and tab completion need no torch."""

from __future__ import annotations

import atexit
import gc
import importlib
import os
import re
import sys
from collections.abc import Callable

import hydra

from .completion import script
from .conf_files import CONF
from .failing import FAILED, fail, speak_any_terminal
from .hydra_setup import register
from .overrides import opened, quote_numeric_names

#: Options that ask something about a command, and run nothing.
ASKING = ("--help", "-h", "--hydra-help", "--version", "--info", "-i", "--shell-completion", "-sc")
#: How rarely garbage is looked for: while a command is imported, and while it runs.
_STARTING, _RUNNING = (100_000, 20, 100), (10_000, 10, 10)


def begin(command: str) -> None:
    """Answer what only asks, and exit; be quick about what is imported next."""
    # Importing and tracing make a million objects that stay: looking for garbage among them, on
    # the way and once more at the end, would take as long as importing torch.
    gc.set_threshold(*_STARTING)
    atexit.register(gc.freeze)
    if asks(sys.argv[1:]):
        answer(command)


def settle() -> None:
    """Look for garbage again, among what is made from now on."""
    if gc.get_threshold() == _STARTING:
        gc.freeze()
        gc.set_threshold(*_RUNNING)


def asks(arguments: list[str]) -> bool:
    """Whether a command line only asks."""
    return any(argument.split("=")[0] in ASKING for argument in arguments)


def answer(command: str) -> None:
    """Let Hydra say what is asked for, and exit."""
    register()
    for shell in ("bash", "zsh"):
        if f"install={shell}" in sys.argv[1:]:
            print(script(sys.argv[0]))
            sys.exit()
    if "COMP_LINE" in os.environ:  # Hydra knows `python FILE` and `NAME`, not `python -m NAME`
        line = re.sub(r"^\s*\S*python\S*\s+-m\s+(?=\S)", "", os.environ["COMP_LINE"])
        *words, last = line.split(" ")
        os.environ["COMP_LINE"] = " ".join([*opened(quote_numeric_names(words)), last])
    sys.argv[1:] = opened(quote_numeric_names(sys.argv[1:]))
    speak_any_terminal()
    try:
        hydra.main(version_base="1.3", config_path=str(CONF), config_name=command)(_nothing)()
        sys.stdout.flush()
    except OSError as error:  # a pager that was closed, a disk that is full
        fail(error, FAILED)
    sys.exit()


def _nothing(cfg: object) -> None:
    pass


def _installed(command: str) -> Callable[[], None]:
    def main() -> None:
        begin(command)
        package = __package__.rpartition(".")[0]
        importlib.import_module(f"{package}.{command}").main()

    return main


#: Of the installed commands `mann-simulate` and so on.
simulate = _installed("simulate")
reproduce = _installed("reproduce")
tune = _installed("tune")
gradient_report = _installed("gradient_report")
peers = _installed("peers")
ablation = _installed("ablation")
ensemble = _installed("ensemble")
export = _installed("export")
online_regression = _installed("online_regression")
tune_problems = _installed("tune_problems")
returning = _installed("returning")
benchmarks = _installed("benchmarks")
