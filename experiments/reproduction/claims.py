"""The paper's qualitative claims, each with the measure that decides it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from .claim_runs import ALWAYS, OURS, STATE
from .results import Results

AFTER = "srmse_after_10s"
#: Two controllers within this many percent of each other count as similar.
SIMILAR = 5.0
#: Mass changes of the illustration [s], and how long after one its first peak is looked for [s].
JUMPS, PEAK_WINDOW = (10.0, 20.0, 40.0), 2.0


@dataclass(frozen=True)
class Finding:
    """A claim, what was measured, and whether it holds here."""

    claim: str
    measure: str
    reproduced: bool


def findings(results: Results) -> list[Finding]:
    """Every claim of the paper's text against the simulations."""
    found = []
    for s in "12345":
        found.append(_lower(results, s, OURS, "soft", "this paper's controller beats soft"))
    for s in "123456":
        metric = AFTER if s == "6" else "srmse"
        found.append(_lower(results, s, OURS, "nn", "this paper's controller beats NN", metric))
    found.append(
        _within(results, "4", OURS, "soft", -SIMILAR, 0.0, "only marginally better than soft")
    )
    for s in ("6", "5", "4_offset", "1_long_arm", "4_long_arm"):
        text = "this paper's controller beats hard attention"
        found.append(_lower(results, s, OURS, "hard", text, AFTER))
    for s in "123":
        text = "hard attention and this paper's controller are similar"
        found.append(_within(results, s, OURS, "hard", -SIMILAR, SIMILAR, text))
    found.append(
        _within(results, "4", "hard", OURS, -SIMILAR, 0.0, "hard attention is marginally superior")
    )
    found.append(_lower(results, "4", STATE, OURS, "state keys beat representation keys"))
    found.append(_lower(results, "1", OURS, STATE, "representation keys beat state keys"))
    found += _illustration(results)
    n_hidden = results.job("nn").n_hidden
    found.append(
        Finding(
            "the equal-parameter network has N = 14", f"computed N = {n_hidden}", n_hidden == 14
        )
    )
    return found


def _lower(
    results: Results, scenario: str, of: str, against: str, text: str, metric: str = "srmse"
) -> Finding:
    changes = [results.change(scenario, of, against, joint, metric) for joint in range(2)]
    late = ", t > 10 s" if metric == AFTER else ""
    measure = f"SRMSE{late}, {of} against {against}: {changes[0]} / {changes[1]}"
    if not all(change.excludes_zero for change in changes):
        measure += " (interval includes 0)"
    return Finding(f"scenario {scenario}: {text}", measure, all(c.mean < 0 for c in changes))


def _within(
    results: Results, scenario: str, of: str, against: str, low: float, high: float, text: str
) -> Finding:
    changes = [results.change(scenario, of, against, joint) for joint in range(2)]
    bounds = f"between {low:+.0f} and {high:+.0f} %"
    measure = f"SRMSE, {of} against {against}, {bounds}: {changes[0]} / {changes[1]}"
    holds = all(low <= change.mean <= high for change in changes)
    return Finding(f"scenario {scenario}: {text}", measure, holds)


def _illustration(results: Results) -> list[Finding]:
    def values(measure: Callable[[dict[str, np.ndarray]], np.ndarray]) -> dict[str, float]:
        variants = ["soft", "hard", OURS, ALWAYS]
        found = {v: float(measure(results.signals("illustration", v)).mean()) for v in variants}
        return found

    shake, swing, stray, peak = (values(m) for m in (_shake, _swing, _stray, _peak))

    def shown(measure: str, numbers: dict[str, float], *names: str) -> str:
        return measure + ": " + ", ".join(f"{name} {numbers[name]:.3g}" for name in names)

    case_1, case_2 = "illustration, case 1: ", "illustration, case 2: "
    rate, read = "RMS de_1/dt after 10 s [mrad/s]", "standard deviation of h_o after 10 s"
    return [
        Finding(
            case_1 + "smaller oscillations than with soft or hard attention",
            shown(rate, shake, OURS, "soft", "hard"),
            shake[OURS] < min(shake["soft"], shake["hard"]),
        ),
        Finding(
            case_1 + "because h_o moves less than with soft or hard attention",
            shown(read, swing, OURS, "soft", "hard"),
            swing[OURS] < min(swing["soft"], swing["hard"]),
        ),
        Finding(
            case_2 + "oscillations smaller than in case 1",
            shown(rate, shake, ALWAYS, OURS),
            shake[ALWAYS] < shake[OURS],
        ),
        Finding(
            case_2 + "h_o is held closer to c_w sigma than in case 1",
            shown("RMS of h_o - c_w sigma after 10 s", stray, ALWAYS, OURS),
            stray[ALWAYS] < stray[OURS],
        ),
        Finding(
            case_2 + "the first peak after a change exceeds soft attention's and case 1's",
            shown("largest |e_1| within 2 s, mean of 3 changes [mrad]", peak, ALWAYS, "soft", OURS),
            peak[ALWAYS] > max(peak["soft"], peak[OURS]),
        ),
    ]


def _late(signals: dict[str, np.ndarray]) -> np.ndarray:
    return signals["t"] > 10.0


def _shake(signals: dict[str, np.ndarray]) -> np.ndarray:
    rate = signals["error_rate"][_late(signals), :, 0]
    return 1e3 * np.sqrt((rate**2).mean(axis=0))


def _swing(signals: dict[str, np.ndarray]) -> np.ndarray:
    return signals["read"][_late(signals)].std(axis=0).mean(axis=-1)


def _stray(signals: dict[str, np.ndarray]) -> np.ndarray:
    gap = signals["read"] - 0.75 * signals["hidden"]
    return np.sqrt((gap[_late(signals)] ** 2).mean(axis=(0, 2)))


def _peak(signals: dict[str, np.ndarray]) -> np.ndarray:
    t, error = signals["t"], np.abs(signals["error"][:, :, 0])
    windows = [error[(t >= jump) & (t <= jump + PEAK_WINDOW)].max(axis=0) for jump in JUMPS]
    return 1e3 * np.mean(windows, axis=0)
