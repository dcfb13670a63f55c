"""The compiled engine beside every other, in one run: `make bench` writes BENCHMARKS.md."""

from __future__ import annotations

import argparse
import importlib.metadata
import os
import platform
import re
import shlex
import sys
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path

import torch

from mann_torch.compiled.host.kernels import lanes_here

from .benchmarking import deploy, events, lines, memory, parts, start
from .benchmarking.curves import precision, scaling
from .benchmarking.measure import ROOT, Section
from .runs.pictures import save
from .runs.writing import write_json, write_text

#: Sections of the page in their order: name, title, what measures it. One that is not measured, by
#: choice or because what it measured is no more (None), stays as it stands on the page.
SECTIONS: dict[str, tuple[str, Callable[[], Section] | None]] = {
    "peers": ("Every engine", lines.section),
    # The hand-written kernel is gone.
    "versus": ("Compiled against hand-written", None),
    "events": ("Rollouts through events", events.section),
    "parts": ("Parts of one's own", parts.section),
    "start": ("The first rollout", start.section),
    "memory": ("The memory beside recurrent layers", memory.section),
    "deploy": ("Ticks of deployed controllers", deploy.section),
    "scaling": ("Cost against horizon and batch", scaling),
    "precision": ("Accuracy against work", precision),
}


def main() -> None:
    """Command line of `python -m experiments.benchmark`."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, default=ROOT / "BENCHMARKS.md", help="the page")
    names = ", ".join(SECTIONS)
    parser.add_argument("--sections", default="", help=f"of {names}; the others stay as they are")
    parser.add_argument("--only", default="", help="engines of `peers`; all if not given")
    options = parser.parse_args()
    chosen = _chosen(parser, options.sections, list(SECTIONS), "section") or list(SECTIONS)
    engines = _chosen(parser, options.only, list(lines.NAMES), "engine")
    found: dict[str, Section] = {}
    for name in chosen:
        measure = SECTIONS[name][1]
        if name == "peers":
            measure = partial(lines.section, engines)
        if measure is not None:
            print(f"{name} ...", file=sys.stderr, flush=True)
            found[name] = measure()
    before = options.out.read_text() if options.out.exists() else ""
    text = page(found, before, _made())
    pictures = options.out.parent / "docs"
    for part in found.values():
        for name, figure in part.figures.items():
            save(figure, pictures / f"{name}.png")
    write_text(options.out, text)
    folder = ROOT / "logs" / "benchmark" / time.strftime("%Y-%m-%d_%H-%M-%S")
    write_json(folder / "results.json", {name: part.numbers for name, part in found.items()})
    print(text)
    print(f"written to {options.out}, {pictures} and {folder}")


def _chosen(parser: argparse.ArgumentParser, given: str, known: list[str], what: str) -> list[str]:
    names = [name for name in given.split(",") if name]
    unknown = set(names) - set(known)
    if unknown:
        parser.error(f"unknown {what} {sorted(unknown)}; choose from {', '.join(known)}")
    return names


def page(found: dict[str, Section], before: str, made: str) -> str:
    """The whole page; sections that were not measured are those of the page before."""
    old = sections_of(before)
    parts = [f"# Benchmarks\n\n{made}\n\nTrust ratios within one run: the machine is shared.\n"]
    for name, (title, _) in SECTIONS.items():
        if name in found:
            parts.append(f"## {title}\n\n{found[name].text}\n")
        elif title in old:
            parts.append(f"## {title}\n\n{old[title]}\n")
    return "\n".join(parts)


def sections_of(text: str) -> dict[str, str]:
    """Texts by title, each with the line that says how it was made."""
    head, *rest = re.split(r"^## ", text, flags=re.MULTILINE)
    made = re.search(r"^Made by .*$", head, flags=re.MULTILINE)
    found = {}
    for part in rest:
        title, _, body = part.partition("\n")
        body = body.strip()
        if made is not None and not body.startswith("Made by "):
            body = f"{made.group()}\n\n{body}"
        found[title.strip()] = body
    return found


def _made() -> str:
    """How, when and on what the page is made, in one line."""
    command = shlex.join(["python", "-m", "experiments.benchmark", *sys.argv[1:]])
    names = ("torch", "warp-lang", "torchdiffeq", "jax", "diffrax", "numpy")
    versions = []
    for name in names:
        try:
            versions.append(f"{name} {importlib.metadata.version(name)}")
        except importlib.metadata.PackageNotFoundError:
            versions.append(f"{name} not installed")
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()
    gpu = torch.cuda.get_device_name() if torch.cuda.is_available() else "no CUDA device"
    vectors = f"{torch.backends.cpu.get_cpu_capability()}, {lanes_here()} lanes of float64"
    return (
        f"Made by `{command}` on {time.strftime('%Y-%m-%d')}: {_cpu()}, {cores} cores, "
        f"{torch.get_num_threads()} threads, {vectors}, {gpu}; "
        f"Python {platform.python_version()}, {', '.join(versions)}."
    )


def _cpu() -> str:
    """The processor's name, with family and model where the system tells them."""
    info = Path("/proc/cpuinfo")
    rows = info.read_text().splitlines() if info.exists() else []
    pairs = [row.split(":", 1) for row in rows if ":" in row]
    told = {key.strip(): value.strip() for key, value in reversed(pairs)}
    if "model name" not in told:
        return platform.processor() or platform.machine()
    number = f"family {told.get('cpu family', '?')}, model {told.get('model', '?')}"
    return f"{told['model name']} ({number})"


if __name__ == "__main__":
    main()
