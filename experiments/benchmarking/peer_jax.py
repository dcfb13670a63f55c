"""The soft-attention loop in JAX: the same W-method in `lax.scan`, and diffrax Tsit5.

A peer to measure against, written once more on its own; only the benchmark imports it.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple, cast

import diffrax
import jax
import jax.numpy as jnp
import numpy as np
import torch
from jax import Array

from mann_torch.plants import TwoLinkArm
from mann_torch.simulation.solvers.implicit import GAMMA
from mann_torch.simulation.step_grid import StepGrid, shares_of

from ..building.build import Experiment

jax.config.update("jax_enable_x64", True)


class State(NamedTuple):
    q: Array
    qd: Array
    W: Array
    b_w: Array
    V: Array
    b_v: Array
    mu: Array


class Peer:
    """One soft-attention loop in one scenario, a batch of initial weights."""

    def __init__(self, made: Experiment, horizon: float) -> None:
        controller, reference = made.loop.controller, made.scenario.reference
        plant = cast(TwoLinkArm, made.loop.plant)
        self.constants = {
            name: jnp.asarray(value.detach().numpy())
            for name, value in controller.constants().items()
        }
        self.reference = [
            jnp.asarray(getattr(reference, name).numpy())
            for name in ("amplitude", "frequency", "offset")
        ]
        knots = made.scenario.knots()
        grid = StepGrid(horizon, knots, made.solver.dt)
        self.knots = jnp.asarray([k for k in knots if k < horizon])
        rows = []
        for segment in grid.segments:
            time = torch.tensor(segment.lookup, dtype=torch.float64)
            c = plant.coefficients(made.scenario.parameters_at(time))
            rows.append(np.array([float(value) for value in c[:5]]))
        self.coefficients = jnp.asarray(np.stack(rows))
        index = np.concatenate([np.full(s.last - s.first, i) for i, s in enumerate(grid.segments)])
        self.grid = (
            jnp.asarray(grid.times[:-1].numpy()),
            jnp.asarray(grid.times.diff().numpy()),
            jnp.asarray(index),
            jnp.asarray(shares_of(grid.times)[1:].numpy()),
        )
        self.horizon = horizon
        network = [jnp.asarray(leaf.numpy()) for leaf in made.weights]
        self.start = jax.vmap(lambda *leaves: self._start(*leaves))(*network)

    def _start(self, W: Array, b_w: Array, V: Array, b_v: Array) -> State:
        zero = jnp.zeros(2)
        y = State(zero, zero, W, b_w, V, b_v, jnp.zeros((5, len(b_v))))
        hidden = self._look(self.sample(jnp.zeros(())), y, self.constants)[3]
        return y._replace(mu=y.mu + self.constants["write_gain"] * hidden)

    def sample(self, t: Array) -> tuple[Array, Array, Array]:
        """s, ds/dt, d2s/dt2."""
        amplitude, frequency, offset = self.reference
        swing = amplitude * jnp.sin(frequency * t)
        return (
            offset + swing,
            amplitude * frequency * jnp.cos(frequency * t),
            -frequency * frequency * swing,
        )

    def _look(self, s: tuple[Array, ...], y: State, c: dict[str, Array]) -> tuple[Array, ...]:
        e, de = s[0] - y.q, s[1] - y.qd
        x = jnp.concatenate([e, de, *s])
        pre = x @ y.V + y.b_v
        return e, de + c["error_gain"] @ e, x, jax.nn.sigmoid(pre), pre

    def rates(self, t: Array, y: State, k: Array, c: dict[str, Array]) -> tuple[State, Any]:
        """dy/dt and the stiff block."""
        s = self.sample(t)
        e, r, x, hidden, pre = self._look(s, y, c)
        weights = jax.nn.softmax(y.mu @ hidden)
        correction = y.W @ r
        slope = hidden * (1 - hidden)
        d_mu = weights[:, None] * (c["write_gain"] * hidden + correction - y.mu)
        norms = _norm(y.W) + _norm(y.V) + _norm(y.mu)
        gain = c["base_gain"] + c["robust_gain"] * (norms + c["weight_bound"])
        torque = gain * r + (hidden + weights @ y.mu) @ y.W + y.b_w
        decay = c["e_modification"] * _norm(e)
        back = slope * correction
        phi, rho, psi, phi_gamma, psi_gamma = k
        coupling = psi * jnp.cos(y.q[1])
        off = rho + coupling
        M = jnp.array([[phi + off + coupling, off], [off, rho]])
        h = psi * jnp.sin(y.q[1])
        V_m = jnp.array([[-h * y.qd[1], -h * (y.qd[0] + y.qd[1])], [h * y.qd[0], 0.0]])
        outer_link = psi_gamma * jnp.cos(y.q[0] + y.q[1])
        load = jnp.array([phi_gamma * jnp.cos(y.q[0]) + outer_link, outer_link])
        rate = gain * jnp.eye(2) + ((y.V[2:4] * slope) @ y.W).T
        position = rate @ c["error_gain"]
        drift = position @ s[1] + rate @ s[2]
        columns = jnp.column_stack([torque - V_m @ y.qd - load, position, rate, drift])
        solved = _solve(M, columns)
        regressor = hidden - slope * pre
        return State(
            y.qd,
            solved[:, 0],
            c["rate_W"] * (jnp.outer(regressor, r) - decay * y.W),
            c["rate_W"] * (r - decay * y.b_w),
            c["rate_V"] * (jnp.outer(x, back) - decay * y.V),
            c["rate_V"] * (back - decay * y.b_v),
            d_mu,
        ), (solved[:, 1:3], solved[:, 3:5], solved[:, 5])

    def step(self, t: Array, h: Array, y: State, k: Array, c: dict[str, Array]) -> State:
        """The W-method of `simulation/solvers/implicit.py`."""
        f, (stiffness, damping, drift) = self.rates(t, y, k, c)
        gh = GAMMA * h
        matrix = jnp.eye(2) + gh * (damping + gh * stiffness)

        def damped(f: State, push: Array) -> State:
            right = f.qd + push - gh * (stiffness @ f.q)
            k_v = _solve(matrix, right[:, None])[:, 0]
            return f._replace(q=f.q + gh * k_v, qd=k_v)

        k_1 = damped(f, gh * drift)
        f_2, _ = self.rates(t + h, jax.tree.map(lambda a, b: a + h * b, y, k_1), k, c)
        k_2 = damped(jax.tree.map(lambda a, b: a - 2 * b, f_2, k_1), -gh * drift)
        return jax.tree.map(lambda a, b, d: a + h * (1.5 * b + 0.5 * d), y, k_1, k_2)

    def implicit(self) -> Callable[[dict[str, Array]], Array]:
        """Compiled: constants -> SRMSE (B, 2) of the W-method."""

        def one(start: State, c: dict[str, Array]) -> Array:
            def body(carry: tuple[State, Array], now: tuple[Array, ...]) -> Any:
                (y, total), (t, h, index, share) = carry, now
                y = self.step(t, h, y, self.coefficients[index], c)
                error = self.sample(t + h)[0] - y.q
                return (y, total + share * error * error), None

            first = (self.sample(jnp.zeros(()))[0] - start.q) ** 2 * self.grid[3][0]
            (_, total), _ = jax.lax.scan(body, (start, first), self.grid)
            return jnp.sqrt(total / (self.horizon + self.grid[3][0]))

        return jax.jit(lambda c: jax.vmap(one, in_axes=(0, None))(self.start, c))

    def tsit5(self) -> Callable[[dict[str, Array]], Array]:
        """Compiled: constants -> SRMSE (B, 2) of diffrax Tsit5, rtol 1e-5."""

        def one(start: State, c: dict[str, Array]) -> Array:
            def field(t: Array, augmented: tuple[State, Array], _: Any) -> Any:
                y = augmented[0]
                row = jnp.searchsorted(self.knots, t, side="right")
                error = self.sample(t)[0] - y.q
                return self.rates(t, y, self.coefficients[row], c)[0], error * error

            solution = diffrax.diffeqsolve(
                diffrax.ODETerm(field),
                diffrax.Tsit5(),
                0.0,
                self.horizon,
                1e-4,
                (start, jnp.zeros(2)),
                stepsize_controller=diffrax.PIDController(1e-5, 1e-8),
                max_steps=10_000_000,
            )
            return jnp.sqrt(solution.ys[1][-1] / self.horizon)

        return jax.jit(lambda c: jax.vmap(one, in_axes=(0, None))(self.start, c))


def _norm(x: Array) -> Array:
    square = jnp.sum(x * x)
    safe = jnp.where(square > 0, square, 1.0)
    return jnp.where(square > 0, jnp.sqrt(safe), 0.0)


def _solve(A: Array, B: Array) -> Array:
    det = A[0, 0] * A[1, 1] - A[0, 1] * A[1, 0]
    return jnp.stack([A[1, 1] * B[0] - A[0, 1] * B[1], A[0, 0] * B[1] - A[1, 0] * B[0]]) / det
