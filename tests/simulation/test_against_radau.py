"""Scorecard N3: both engines against SciPy's Radau on equations written out here."""

import numpy as np
import pytest
import torch
from numpy import ndarray
from scipy.integrate import solve_ivp

import mann_torch as mt
from mann_torch.trees import leaves
from tests.simulation.loops import CONSTANTS, case

N, S = 6, 4
USED = np.array([True, True, False, True])  # as `loops.case` stores them
MASSES = [[0.8, 2.3], [0.5, 1.2], [1.1, 2.9]]
LENGTHS, VISCOUS, COULOMB = (1.0, 1.1), np.array([0.3, 0.2]), np.array([0.2, 0.0])
AMPLITUDE, FREQUENCY, OFFSET = np.array([1.0, 0.3]), np.array([0.5, 0.7]), np.array([0.1, -0.2])


def flow(t: float, y: ndarray, masses: list[float], shapes: list[tuple[int, ...]]) -> ndarray:
    """The closed loop of the paper, one sample."""
    cuts = np.cumsum([int(np.prod(shape)) for shape in shapes])[:-1]
    parts = [p.reshape(s) for p, s in zip(np.split(y, cuts), shapes, strict=True)]
    q, qd, W, b_w, V, b_v = parts[:6]
    c = CONSTANTS
    swing = AMPLITUDE * np.sin(FREQUENCY * t)
    s, ds, dds = OFFSET + swing, AMPLITUDE * FREQUENCY * np.cos(FREQUENCY * t), -(FREQUENCY**2)
    dds = dds * swing
    e, de = s - q, ds - qd
    r = de + np.array(c["error_gain"]) @ e
    x = np.concatenate([e, de, s, ds, dds])
    pre = V.T @ x + b_v
    sigma = 1 / (1 + np.exp(-pre))
    slope = sigma * (1 - sigma)
    norms, read, d_memory = np.linalg.norm(W) + np.linalg.norm(V), np.zeros(N), []
    if len(parts) > 6:
        mu, keys = parts[6:]
        score = keys @ q if keys.size else mu @ sigma
        w = np.where(USED, np.exp(score - score.max()), 0.0)
        w = w / w.sum()
        read = w @ mu
        norms += np.linalg.norm(mu[USED])
        d_mu = -w[:, None] * mu + c["write_gain"] * np.outer(w, sigma) + np.outer(w, W @ r)
        d_keys = -c["key_rate"] * w[:, None] * (keys - q) if keys.size else keys
        d_memory = [d_mu, d_keys]
    gain = c["base_gain"] + c["robust_gain"] * (norms + c["weight_bound"])
    torque = gain * r + W.T @ (sigma + read) + b_w
    decay, back = c["e_modification"] * np.linalg.norm(e), slope * (W @ r)
    d_W = c["rate_W"] * (np.outer(sigma - slope * pre, r) - decay * W)
    d_V = c["rate_V"] * (np.outer(x, back) - decay * V)
    d_b_w, d_b_v = c["rate_W"] * (r - decay * b_w), c["rate_V"] * (back - decay * b_v)
    (m_1, m_2), (l_1, l_2), g = masses, LENGTHS, 9.8
    phi, rho, psi = (m_1 + m_2) * l_1**2, m_2 * l_2**2, m_2 * l_1 * l_2
    cos, sin = np.cos(q[1]), np.sin(q[1])
    M = np.array([[phi + rho + 2 * psi * cos, rho + psi * cos], [rho + psi * cos, rho]])
    centripetal = psi * sin * np.array([-(2 * qd[0] * qd[1] + qd[1] ** 2), qd[0] ** 2])
    outer = psi * g / l_1 * np.cos(q[0] + q[1])
    load = np.array([phi * g / l_1 * np.cos(q[0]) + outer, outer])
    load = load + VISCOUS * qd + COULOMB * np.tanh(qd / 0.01)
    qdd = np.linalg.solve(M, torque - centripetal - load)
    rates = [qd, qdd, d_W, d_b_w, d_V, d_b_v, *d_memory]
    return np.concatenate([rate.ravel() for rate in rates])


def error(name: str, engine: str, dt: float, horizon: float) -> float:
    """The largest error of any state at the end."""
    made = case(name, horizon, batch=1)
    with torch.no_grad():
        run = made.run(solver=mt.Implicit(dt), engine=engine, sample_dt=horizon)
    rows = [leaf[:, 0].numpy() for leaf in leaves(run.states)]
    shapes = [row.shape[1:] for row in rows]
    y, end = (np.concatenate([row[k].ravel() for row in rows]) for k in (0, -1))
    times = [0.0, 0.3 * horizon, 0.7 * horizon, horizon]
    for k, masses in enumerate(MASSES):
        span = (times[k], times[k + 1])
        solved = solve_ivp(flow, span, y, "Radau", args=(masses, shapes), rtol=1e-9, atol=1e-11)
        y = solved.y[:, -1]
    return float(np.abs(y - end).max())


SLOW = [pytest.param(name, marks=pytest.mark.slow) for name in ("soft", "soft_state_keys")]


@pytest.mark.parametrize("name", ["nn", *SLOW])
def test_the_compiled_engine_falls_to_radau_with_order_two(name: str) -> None:
    coarse, fine = (error(name, "compiled", dt, 0.1) for dt in (4e-5, 2e-5))
    assert fine <= 1e-6
    assert 3.6 <= coarse / fine <= 4.4, (coarse, fine)


@pytest.mark.slow
def test_the_torch_engine_meets_radau() -> None:
    assert error("nn", "torch", 5e-5, 0.1) <= 1e-6
