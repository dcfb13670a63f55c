"""One table and one picture of finished runs: of several sweeps, from several machines."""

from __future__ import annotations

import argparse
import shlex
import sys
import time
from pathlib import Path
from typing import NoReturn

from mann_torch.errors import ConfigError, MannError

from .command.failing import BAD_INPUT, fail
from .command.started import as_started
from .sweeps.gather import runs_below, same_command
from .sweeps.report import write_sweep


class _Parser(argparse.ArgumentParser):
    def error(self, message: str) -> NoReturn:
        fail(ConfigError(message), BAD_INPUT)


def main() -> None:
    """Command line of `python -m experiments.collect`."""
    parser = _Parser(prog=" ".join(as_started("collect")), description=__doc__)
    parser.add_argument("folder", nargs="+", type=Path, help="a sweep's folder, or any above runs")
    parser.add_argument(
        "--out", type=Path, help="where to write; the folder itself if it is one, logs/collect else"
    )
    options = parser.parse_args()
    folders = list(dict.fromkeys(options.folder))
    alone = len(folders) == 1
    try:
        runs = []
        for folder in folders:
            runs += runs_below(folder, "" if alone else f"{folder.as_posix()}/")
        same_command(runs)
        stamp = Path("logs") / "collect" / time.strftime("%Y%m%d-%H%M%S")
        out = options.out or (folders[0] if alone else stamp)
        command = shlex.join([*as_started("collect"), *sys.argv[1:]])
        write_sweep(out, runs, command)
    except (MannError, OSError) as error:
        fail(error, BAD_INPUT)


if __name__ == "__main__":
    main()
