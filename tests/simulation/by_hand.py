"""The paper's closed loop written out again in numpy, and SciPy's Radau on it."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
import torch
from numpy import ndarray
from scipy.integrate import solve_ivp

import mann_torch as mt
from mann_torch.trees import leaves
from mann_torch.types import LoopState

GRAVITY, COULOMB_VELOCITY = 9.8, 0.01


class Equations(NamedTuple):
    """One sample's numbers. Rates are those of columns, y (M, K), or of one state, y (M,)."""

    c: Mapping[str, ndarray]  # the controller's constants
    swing: tuple[ndarray, ndarray, ndarray]  # amplitude, frequency, offset, each (2,)
    arm: tuple[ndarray, ndarray, ndarray, ndarray]  # masses, lengths, viscous, coulomb, each (2,)
    shapes: Sequence[tuple[int, ...]]  # of q, qd, W, b_w, V, b_v and, with a memory, mu, keys
    used: ndarray | None = None  # (S,) bool
    held: ndarray | None = None  # (S,) weights of attention that switches; None: soft

    def parts(self, y: ndarray) -> list[ndarray]:
        """The state's members, each (K, *shape)."""
        cuts = np.cumsum([int(np.prod(shape)) for shape in self.shapes])[:-1]
        pieces = np.split(y.reshape(len(y), -1).T, cuts, axis=1)
        return [p.reshape(len(p), *s) for p, s in zip(pieces, self.shapes, strict=True)]

    def __call__(self, t: float, y: ndarray) -> ndarray:
        """dy/dt, shaped like y."""
        q, qd, W, b_w, V, b_v, *memory = self.parts(y)
        c, (e, r, x) = self.c, self.errors(t, q, qd)
        pre = (x[:, None] @ V)[:, 0] + b_v
        sigma = 1 / (1 + np.exp(-pre))
        slope, W_r = sigma * (1 - sigma), (W @ r[:, :, None])[:, :, 0]
        norms, h, d_memory = norm(W) + norm(V), sigma, []
        if memory:
            (mu, keys), w = memory, self.attended(q, sigma, *memory)
            h = sigma + (w[:, None] @ mu)[:, 0]
            norms = norms + norm(mu[:, self.used])
            d_memory = [w[:, :, None] * ((c["write_gain"] * sigma + W_r)[:, None] - mu)]
            d_memory += [c["key_rate"] * w[:, :, None] * (q[:, None] - keys)] if keys.size else []
        gain = c["base_gain"] + c["robust_gain"] * (norms + c["weight_bound"])
        torque = gain[:, None] * r + (h[:, None] @ W)[:, 0] + b_w
        decay, back = c["e_modification"] * norm(e[:, None])[:, None], slope * W_r
        thick = decay[:, :, None]
        d_W = c["rate_W"] * ((sigma - slope * pre)[:, :, None] * r[:, None] - thick * W)
        d_V = c["rate_V"] * (x[:, :, None] * back[:, None] - thick * V)
        d_b_w, d_b_v = c["rate_W"] * (r - decay * b_w), c["rate_V"] * (back - decay * b_v)
        rates = [qd, self.acceleration(q, qd, torque), d_W, d_b_w, d_V, d_b_v, *d_memory]
        flat = np.concatenate([rate.reshape(len(q), -1) for rate in rates], axis=1)
        return flat.T.reshape(y.shape)

    def errors(self, t: float, q: ndarray, qd: ndarray) -> tuple[ndarray, ndarray, ndarray]:
        """e and r (K, 2), and the network's input (K, 10)."""
        amplitude, frequency, offset = self.swing
        s = offset + amplitude * np.sin(frequency * t)
        ds = amplitude * frequency * np.cos(frequency * t)
        dds = -(frequency**2) * (s - offset)
        e, de = s - q, ds - qd
        r = de + e @ np.asarray(self.c["error_gain"]).T
        wide = (np.broadcast_to(a, q.shape) for a in (s, ds, dds))
        return e, r, np.concatenate([e, de, *wide], axis=1)

    def attended(self, q: ndarray, sigma: ndarray, mu: ndarray, keys: ndarray) -> ndarray:
        """Weights of soft attention (K, S), or those held."""
        if self.held is not None:
            return np.broadcast_to(self.held, mu.shape[:2])
        score = (keys @ q[:, :, None] if keys.size else mu @ sigma[:, :, None])[:, :, 0]
        w = np.where(self.used, np.exp(score - score.max(axis=1, keepdims=True)), 0.0)
        return w / w.sum(axis=1, keepdims=True)

    def acceleration(self, q: ndarray, qd: ndarray, torque: ndarray) -> ndarray:
        """qdd (K, 2) from M qdd + C qd + gravity + friction = torque."""
        (m_1, m_2), (l_1, l_2), viscous, coulomb = self.arm
        phi, rho, psi = (m_1 + m_2) * l_1**2, m_2 * l_2**2, m_2 * l_1 * l_2
        cos, sin = psi * np.cos(q[:, 1]), psi * np.sin(q[:, 1])
        outer = psi * GRAVITY / l_1 * np.cos(q[:, 0] + q[:, 1])
        load = np.stack([phi * GRAVITY / l_1 * np.cos(q[:, 0]) + outer, outer], axis=1)
        load += viscous * qd + coulomb * np.tanh(qd / COULOMB_VELOCITY)
        load[:, 0] -= sin * (2 * qd[:, 0] * qd[:, 1] + qd[:, 1] ** 2)
        load[:, 1] += sin * qd[:, 0] ** 2
        f_1, f_2 = (torque - load).T
        # Cramer's rule for M = [[a, b], [b, rho]].
        a, b = phi + rho + 2 * cos, rho + cos
        qdd = np.stack([rho * f_1 - b * f_2, a * f_2 - b * f_1], axis=1)
        return qdd / (a * rho - b * b)[:, None]


def norm(x: ndarray) -> ndarray:
    """Frobenius (K,) of (K, i, j)."""
    return np.sqrt((x * x).sum(axis=(1, 2)))


def equations_of(
    loop: mt.ClosedLoop, scenario: mt.Scenario, states: LoopState, used: torch.Tensor | None
) -> tuple[Equations, list[ndarray]]:
    """Of one sample's loop and scenario, and of its states (T, *event), the rows (M,)."""
    rows = [leaf.numpy() for leaf in leaves(states)]
    swing, arm = scenario.reference, scenario.parameters
    assert isinstance(swing, mt.Sinusoid)
    made = Equations(
        c={k: v.detach().numpy() for k, v in loop.controller.constants().items()},
        swing=tuple(v.numpy() for v in (swing.amplitude, swing.frequency, swing.offset)),
        arm=tuple(v.numpy() for v in arm),
        shapes=[row.shape[1:] for row in rows],
        used=None if used is None else used.numpy(),
    )
    return made, [np.concatenate([r[k].ravel() for r in rows]) for k in range(len(rows[0]))]


def radau(
    equations: Equations,
    masses: mt.PiecewiseConstant,
    y: ndarray,
    times: Sequence[float],
    **tolerances: float,
) -> list[ndarray]:
    """States (M,) at `times` from y at the first of them, solved anew from each mass jump."""
    jumps = [knot for knot in masses.knots() if times[0] < knot < times[-1]]
    stops, found = sorted({*times, *jumps}), [y]
    for start, end in itertools.pairwise(stops):
        (m,) = masses.at(torch.tensor([start], dtype=torch.float64)).numpy()
        held = equations._replace(arm=(m, *equations.arm[1:]))
        options: dict[str, Any] = {"method": "Radau", "vectorized": True, **tolerances}
        solved = solve_ivp(held, (start, end), found[-1], **options)
        assert solved.success, solved.message
        found.append(solved.y[:, -1])
    return [found[stops.index(time)] for time in times]
