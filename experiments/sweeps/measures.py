"""What a table of runs shows of each command's metrics.json."""

from __future__ import annotations

import itertools
import re
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from ..runs.intervals import Interval, interval

Measured = dict[str, Interval]
NOTHING = Interval(float("nan"), float("nan"))


def command_of(record: Mapping[str, Any]) -> str:
    """The command that made a record; empty if that is none of ours."""
    found = re.search(r"(?:\bexperiments\.|^mann-)([\w-]+)", str(record.get("command", "")))
    name = found.group(1).replace("-", "_") if found else ""
    return name if name in READERS else ""


def measured(record: Mapping[str, Any]) -> tuple[Measured, str]:
    """Means with intervals, the leading one first, and how many draws of the run diverged."""
    return READERS[command_of(record)](record), _diverged(record)


def units_of(record: Mapping[str, Any]) -> dict[str, str]:
    """Of the metrics that are in a unit of an output."""
    outputs = record.get("outputs", [])
    of = [(each["name"], each["unit"]) for each in outputs if isinstance(each, Mapping)]
    heads = ("srmse", "srmse_after_10s")
    return {f"{head}_{name}": unit for head in heads for name, unit in of if unit}


def _diverged(record: Mapping[str, Any]) -> str:
    if command_of(record) == "ensemble":
        lost, of = record["diverged"], record["rollouts"]
    else:
        status = record.get("status", [])
        lost, of = sum(each != "ok" for each in status), len(status)
    return f"{lost} of {of} draws diverged" if lost else "ok"


def _over_draws(values: Sequence[Any]) -> Interval:
    """Draws without a value (diverged, nothing after 10 s) are left out."""
    found = np.array([value for value in values if value is not None], dtype=float)
    return interval(found) if len(found) else NOTHING


def _one(value: Any) -> Interval:
    return NOTHING if value is None else Interval(float(value), float("nan"))


def _simulate(record: Mapping[str, Any]) -> Measured:
    found = {}
    for name in ("srmse", "srmse_after_10s"):
        for output, values in zip(record["outputs"], zip(*record[name], strict=True), strict=True):
            found[f"{name}_{output['name']}"] = _over_draws(values)
    for name in ("reallocations", "switches"):
        found[name] = _over_draws(record[name])
    return found


def _ensemble(record: Mapping[str, Any]) -> Measured:
    """Means over rollouts, and what a hundredth of them exceeds."""
    of = record["measures"]
    found = {name: Interval(_one(m["mean"]).mean, _one(m["half"]).mean) for name, m in of.items()}
    leading = [f"srmse_{output['name']}" for output in record["outputs"]]
    return found | {f"{name}_q99": _one(of[name]["q99"]) for name in leading}


def _gradient_report(record: Mapping[str, Any]) -> Measured:
    found = {name: _over_draws(record[name]) for name in ("srmse", "switches", "reallocations")}
    return found | {
        f"norm_{mode}": _one(points[-1][1]) for mode, points in record["norms"].items() if points
    }


def _tune(record: Mapping[str, Any]) -> Measured:
    """Objective at the end and the start, the constants, and changes on scenarios held out [%]."""
    history = [entry["objective"] for entry in record["history"]]
    found = {}
    if history:
        found = {"objective": _one(history[-1]), "objective_first": _one(history[0])}
    tuned = [v["srmse"]["mean"] for v in record["held_out"] if v["candidate"] == "tuned"]
    if tuned and None not in tuned:
        found["held_out_srmse"] = _one(np.mean(tuned))
    for name, value in record["constants"].items():
        if not isinstance(value, list):
            found[name] = _one(value)
        elif isinstance(value[0], list):
            places = itertools.product(range(len(value)), range(len(value[0])))
            found |= {f"{name}_{i + 1}{j + 1}": _one(value[i][j]) for i, j in places if value[i][j]}
        else:
            found |= {f"{name}_{i + 1}": _one(each) for i, each in enumerate(value)}
    for verdict in record["held_out"]:
        start = f"{verdict['candidate']}_{verdict['scenario']}".replace(" ", "_")
        for name in ("srmse", "rate", "peak"):
            mean, half = (verdict[name][part] for part in ("mean", "half"))
            spread = float("nan") if half is None else float(half)
            found[f"{start}_{name}"] = Interval(_one(mean).mean, spread)
    return found


def _reproduce(record: Mapping[str, Any]) -> Measured:
    """Published figures met, each counted once, claims that hold and golden runs that agree."""
    cells = {
        (cell["scenario"], cell["variant"], cell["metric"], cell["joint"]): cell
        for cell in record["cells"]
        if cell["paper"] is not None
    }
    off = [
        abs(cell["mean"] / cell["paper"] - 1) if cell["mean"] is not None else float("inf")
        for cell in cells.values()
    ]
    return {
        "within_10_percent": _one(sum(each <= 0.1 for each in off)),
        "within_5_percent": _one(sum(each <= 0.05 for each in off)),
        "figures": _one(len(off)),
        "claims_reproduced": _one(sum(claim["reproduced"] for claim in record["claims"])),
        "claims": _one(len(record["claims"])),
        "golden_passed": _one(sum(check["passed"] for check in record["golden"])),
        "golden": _one(len(record["golden"])),
    }


def _benchmarks(record: Mapping[str, Any]) -> Measured:
    """Numbers off and agreeing; of each problem the largest deviation in parts of what may be."""
    run = [row for row in record["rows"] if row["verdict"] != "not run"]
    found = {
        "off": _one(sum(row["verdict"] == "off" for row in run)),
        "agree": _one(sum(row["verdict"] == "agrees" for row in run)),
    }
    for problem in dict.fromkeys(row["problem"] for row in run):
        own = [row["margin"] for row in run if row["problem"] == problem]
        found[f"margin_{problem}"] = _one(max((m for m in own if m is not None), default=None))
    return found


def _export(record: Mapping[str, Any]) -> Measured:
    """Sizes of the state, and of each runtime's files."""
    found = {"state_numbers": _one(record["state_numbers"])}
    for runtime, files in record["files"].items():
        found[f"bytes_{runtime}"] = _one(sum(files.values()))
    return found


def _learning(record: Mapping[str, Any]) -> Measured:
    """Every measure of every variant, of each task where there are several, over seeds."""
    found = {}
    for row in record["table"]:
        whose = "_".join(row[key] for key in ("task", "variant") if key in row)
        for name in [name for name in row if f"{name}_half" in row]:
            half = row[f"{name}_half"]
            spread = float("nan") if half is None else float(half)
            found[f"{name}_{whose}"] = Interval(_one(row[name]).mean, spread)
    return found


def _ablation(record: Mapping[str, Any]) -> Measured:
    """Every measure of every variant of every table, over seeds."""
    found = {}
    for row in record["table"]:
        half = row["value_half"]
        spread = float("nan") if half is None else float(half)
        name = f"{row['measure']}_{row['task']}_{row['variant']}"
        found[name] = Interval(_one(row["value"]).mean, spread)
    return found


READERS: dict[str, Callable[[Mapping[str, Any]], Measured]] = {
    "simulate": _simulate,
    "ensemble": _ensemble,
    "tune": _tune,
    "gradient_report": _gradient_report,
    "export": _export,
    "reproduce": _reproduce,
    "benchmarks": _benchmarks,
    "peers": _learning,
    "ablation": _ablation,
    "online_regression": _learning,
    "tune_problems": _learning,
    "returning": _learning,
}
