"""
A policy by reinforcement learning
==================================

A pendulum whose motor is too weak to lift it has to swing itself up. The plant becomes a Gymnasium
environment, 256 of them in a batch, and a network of 41 weights, (sin q, cos q, dq/dt) to torque,
is trained by the cross-entropy method (Mannor, Rubinstein and Gat 2003): every pendulum gets
weights of its own, and the best 25 say where the next generation's are drawn. Left: returns, the
sum of ``-cos q`` over the steps. Right: the best of three generations.
"""

import matplotlib.pyplot as plt
import numpy as np

import mann_torch as mt
from mann_torch.plants import Pendulum
from mann_torch.signals import Polynomial
from mann_torch.simulators import PlantVectorEnv

plt.style.use("mann_torch.paper")

N, STEPS = 256, 120
plant, upright = Pendulum(), Polynomial([[np.pi]])
swing = mt.Scenario(upright, plant.parameters_of(viscous=[0.1]), horizon=6.0)
motor = mt.Actuator(1, limit=4.0)  # [N m]; gravity pulls with up to 9.81
env = PlantVectorEnv(N, plant, swing, 0.05, actuator=motor, reward=lambda m: m.error.cos().sum(-1))


def episode(weights):
    """Angles (STEPS, N) and returns (N,) of N networks, one a pendulum."""
    V, b, w, c = np.split(weights, [24, 32, 40], axis=1)
    seen, angles, total = env.reset()[0], [], np.zeros(N)
    for _ in range(STEPS):
        z = np.stack([np.sin(seen[:, 0]), np.cos(seen[:, 0]), 0.2 * seen[:, 1]], axis=1)
        hidden = np.tanh(np.einsum("bih,bi->bh", V.reshape(N, 3, 8), z) + b)
        seen, reward, *_ = env.step(4.0 * np.tanh((w * hidden).sum(1, keepdims=True) + c))
        angles.append(seen[:, 0])
        total += reward
    return np.stack(angles), total


random = np.random.default_rng(0)
mean, spread, returns = np.zeros(41), 2.0 * np.ones(41), []
figure, (left, right) = plt.subplots(1, 2, figsize=(6.4, 2.8))
for generation in range(1, 31):
    weights = mean + spread * random.standard_normal((N, 41))
    angles, total = episode(weights)
    order = total.argsort()
    mean, spread = weights[order[-25:]].mean(0), weights[order[-25:]].std(0) + 0.02
    returns.append(total[order[[N // 2, -25, -1]]])
    if generation in (1, 10, 30):
        right.plot(0.05 * np.arange(STEPS), angles[:, order[-1]], label=f"generation {generation}")
left.plot(np.arange(1, 31), returns, label=["median", "25th best", "best"])
left.set(xlabel="generation", ylabel="return")
left.legend(loc="lower right")
right.axhline(np.pi, color="k", lw=0.8, ls="--", label="upright")
right.set(xlabel="t [s]", ylabel="q [rad]")
right.legend(loc="lower left")
plt.show()
