"""The loop under attention that switches: Radau between events, each located to rounding."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy import ndarray
from scipy.integrate import solve_ivp

from tests.simulation.by_hand import Equations

TOLERANCES = {"method": "Radau", "vectorized": True, "rtol": 1e-10, "atol": 1e-12}
SAME = 1e-12  # what counts as equally far
SOON = 1e-7  # [s]: how soon after an event the next one makes it chattering


class Rule(NamedTuple):
    """Hard attention, and whether and until when it resets slots."""

    theta: float | None  # None: never
    always: bool


class Event(NamedTuple):
    """A switch, or a reset (and where attention is after it)."""

    time: float
    attended: int
    reset: bool


class Switching:
    """One sample; `equations` hold the weights of the slot attended and the slots in use."""

    def __init__(self, equations: Equations, rule: Rule, y: ndarray) -> None:
        assert equations.used is not None
        self.rule, self.y, self.t = rule, y, 0.0
        self.equations, self.events = equations, list[Event]()
        self._attend(int(self.distances(0.0, y).argmin()), equations.used)
        self.fresh = True

    def _attend(self, slot: int, used: ndarray) -> None:
        self.slot = slot
        held = np.eye(len(used))[slot]
        self.equations = self.equations._replace(held=held, used=used)

    def _look(self, t: float, y: ndarray) -> tuple[ndarray, ...]:
        q, qd, _, _, V, b_v, mu, keys = self.equations.parts(y)
        x = self.equations.errors(t, q, qd)[2]
        sigma = 1 / (1 + np.exp(-(x[0] @ V[0] + b_v[0])))
        relevance = np.abs(sigma - mu[0] / self.equations.c["write_gain"]).max(axis=1)
        return q[0], sigma, keys[0], relevance

    def distances(self, t: float, y: ndarray) -> ndarray:
        """Of each slot's key from the query (S,); inf where it is not in use."""
        q, _, keys, relevance = self._look(t, y)
        own = np.abs(q - keys).max(axis=1) if keys.size else relevance
        return np.where(self.equations.used, own, np.inf)

    def overdue(self, t: float, y: ndarray) -> float:
        """How far the nearest relevance is beyond theta; a reset is due where >= 0."""
        used = self.equations.used
        if self.rule.theta is None or (used.all() and not self.rule.always):
            return -np.inf
        return float(self._look(t, y)[3][used].min() - self.rule.theta)

    def gaps(self, t: float, y: ndarray) -> ndarray:
        """(S + 1,): the next event is where one becomes positive. Slots, then the reset."""
        d = self.distances(t, y)
        gaps = d[self.slot] - d
        gaps[self.slot] = -np.inf
        return np.append(gaps, self.overdue(t, y))

    def flow(self, end: float, masses: ndarray) -> bool:
        """To `end` through its events, with these masses; False if slots begin to chatter.

        They do where the slot just attended drives the state straight back to another event.
        """
        arm = (masses, *self.equations.arm[1:])
        while self.t < end:
            self.equations = self.equations._replace(arm=arm)
            if self.fresh:  # rounding may have left a gap on the wrong side: begin beyond it
                soon = min(self.t + SOON, end)
                self.y, self.t = self._solved(self.t, soon, self.y), soon
                self.fresh = False
                if self.gaps(self.t, self.y).max() > 0:
                    return False

            if self.t == end:
                return True

            def nearest(t: float, y: ndarray) -> float:
                return float(self.gaps(t, y).max())

            nearest.terminal, nearest.direction = True, 1  # type: ignore[attr-defined]
            found = solve_ivp(self.equations, (self.t, end), self.y, events=nearest, **TOLERANCES)
            assert found.success, found.message
            if found.status == 0:
                self.t, self.y = end, found.y[:, -1]
                assert nearest(end, self.y) <= 0, "an event was missed"
            else:
                self._locate(found.t[-2:], found.y[:, -2])
                self._happen()
        return True

    def _locate(self, times: Sequence[float], y: ndarray) -> None:
        """The event itself. What `solve_ivp` reports lies on an interpolant of lower order."""
        (t, root), which = times, -1
        for _ in range(4):
            y = self._solved(t, root, y)
            t, gaps = root, self.gaps(root, y)
            which = int(gaps.argmax())
            delta = 1e-7
            ahead = self._solved(t, t + delta, y)
            slope = (self.gaps(t + delta, ahead)[which] - gaps[which]) / delta
            root = t - gaps[which] / slope
        self.t, self.y = t, y

    def _solved(self, start: float, end: float, y: ndarray) -> ndarray:
        if start == end:
            return y
        return solve_ivp(self.equations, (start, end), y, **TOLERANCES).y[:, -1]

    def _happen(self) -> None:
        gaps, used = self.gaps(self.t, self.y), self.equations.used
        reset = abs(gaps[-1]) <= SAME
        if not reset:
            self._attend(int((gaps[:-1] >= -SAME).argmax()), used)
        else:
            self._reset(int(np.argmin(used)) if not used.all() else self._least_relevant())
        self.events.append(Event(float(self.t), self.slot, bool(reset)))
        self.fresh = True

    def _least_relevant(self) -> int:
        return int(self._look(self.t, self.y)[3].argmax())

    def _reset(self, slot: int) -> None:
        """The slot gets c_w sigma and a fresh key; the nearest one is attended."""
        q, sigma, _, _ = self._look(self.t, self.y)
        y = self.y.copy()
        *_, mu, keys = self.equations.parts(y)
        sizes = [int(np.prod(shape)) for shape in self.equations.shapes]
        mu, keys = mu[0].copy(), keys[0].copy()
        mu[slot] = self.equations.c["write_gain"] * sigma
        if keys.size:
            keys[slot] = q
        y[-sizes[-1] - sizes[-2] :] = np.concatenate([mu.ravel(), keys.ravel()])
        used = self.equations.used.copy()
        used[slot] = True
        self.y, self.equations = y, self.equations._replace(used=used)
        self._attend(int(self.distances(self.t, y).argmin()), used)
