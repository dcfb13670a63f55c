"""
L1 adaptive control: scaled responses
=====================================

A plant that is unstable in truth, ``x' = A_m x + b(u + θ'x)`` with θ = (4, -4.5), is to follow
steps. L1 adaptive control adapts fast and filters its input by ``C(s) = ω_c/(s + ω_c)``: the
responses are scaled copies of one another, as a linear system's would be. MRAC's are not: its
transient depends on how large the step is. Hovakimyan and Cao 2010, L1 Adaptive Control Theory.
"""

import matplotlib.pyplot as plt
import torch

import mann_torch as mt
from mann_torch.control import AdaptiveLaw, ConstantGain, Identity, L1Adaptive, LinearNetwork, Mrac
from mann_torch.plants import LinearPlant
from mann_torch.signals import Polynomial

plt.style.use("mann_torch.paper")

A_m, B, C = [[0.0, 1.0], [-1.0, -1.4]], [[0.0], [1.0]], [[1.0, 0.0]]
plant = LinearPlant(A=[[0.0, 1.0], [3.0, -5.9]], B=B, C=C, measured="state")
steps = torch.tensor([25.0, 100.0, 400.0], dtype=torch.float64)
scenario = mt.Scenario(Polynomial(steps[:, None, None]), plant.parameters_of(), horizon=10.0)
network = LinearNetwork(Identity(3), 1, AdaptiveLaw(ConstantGain(1e-3)))
loops = {
    "L1": (mt.ClosedLoop(plant, L1Adaptive(A_m, B, bandwidth=160.0)), 2e-5),
    "MRAC": (
        mt.ClosedLoop(
            plant,
            Mrac.of_model(A_m, B, network, feedforward=[[1.0]]),
            model=mt.LinearModel(A_m, B, C),
        ),
        2e-4,
    ),
}
figure, axes = plt.subplots(1, 2, sharey=True, figsize=(6.4, 2.8))
for ax, (name, (loop, dt)) in zip(axes, loops.items(), strict=True):
    with torch.no_grad():
        run = mt.rollout(loop, scenario, mt.RungeKutta(dt), motion_dt=0.02)
    for k, (step, style) in enumerate(zip(steps, ("-", "--", ":"), strict=True)):
        ax.plot(run.t, run.output[:, k, 0] / step, style, lw=1.5, label=f"r = {step:.0f}")
    ax.set(title=name, xlabel="t [s]")
axes[0].set_ylabel("y / r")
axes[1].legend()
plt.show()
