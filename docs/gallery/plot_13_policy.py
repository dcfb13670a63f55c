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

N, BEST, GENERATIONS, STEPS, DT, LIMIT = 256, 25, 30, 120, 0.05, 4.0  # [s], [N m]
plant, upright = Pendulum(), Polynomial([[np.pi]])
swing = mt.Scenario(upright, plant.parameters_of(viscous=[0.1]), horizon=STEPS * DT)
# Gravity pulls with up to 9.81 N m.
motor, reward = mt.Actuator(1, limit=LIMIT), lambda motion: motion.error.cos().sum(-1)
env = PlantVectorEnv(N, plant, swing, DT, actuator=motor, reward=reward)


def episode(weights):
    """Angles (STEPS, N) and returns (N,) of N networks, one a pendulum."""
    V, b, w, c = np.split(weights, [24, 32, 40], axis=1)
    seen, angles, total = env.reset()[0], [], np.zeros(N)
    for _ in range(STEPS):
        z = np.stack([np.sin(seen[:, 0]), np.cos(seen[:, 0]), 0.2 * seen[:, 1]], axis=1)
        hidden = np.tanh(np.einsum("bih,bi->bh", V.reshape(N, 3, 8), z) + b)
        seen, reward, *_ = env.step(LIMIT * np.tanh((w * hidden).sum(1, keepdims=True) + c))
        angles.append(seen[:, 0])
        total += reward
    return np.stack(angles), total


random = np.random.default_rng(0)
mean, spread, returns = np.zeros(41), 2.0 * np.ones(41), []
figure, (left, right) = plt.subplots(1, 2, figsize=(6.4, 2.8))
for generation in range(1, GENERATIONS + 1):
    weights = mean + spread * random.standard_normal((N, 41))
    angles, total = episode(weights)
    order = total.argsort()
    mean, spread = weights[order[-BEST:]].mean(0), weights[order[-BEST:]].std(0) + 0.02
    returns.append(total[order[[N // 2, -BEST, -1]]])
    if generation in (1, GENERATIONS // 3, GENERATIONS):
        right.plot(DT * np.arange(STEPS), angles[:, order[-1]], label=f"generation {generation}")
left.plot(np.arange(1, GENERATIONS + 1), returns, label=["median", f"{BEST}th best", "best"])
left.set(xlabel="generation", ylabel="return")
left.legend(loc="lower right")
right.axhline(np.pi, color="k", lw=0.8, ls="--", label="upright")
right.set(xlabel="t [s]", ylabel="q [rad]")
right.legend(loc="lower left")
plt.show()
