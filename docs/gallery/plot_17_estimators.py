"""
Estimators of two parameters
============================

``y = θ'φ`` with φ = (sin t, cos t), and estimates that begin at 0. The gradient law is
``dθ/dt = Γ φ (y - θ'φ)``; least squares are faster at first and then slow down, unless they forget;
DREM makes two scalar problems of one, and each error only shrinks; concurrent learning replays what
it has recorded. Ioannou and Sun, Robust Adaptive Control; Aranovskiy et al. 2017; Chowdhary and
Johnson 2010.
"""

import matplotlib.pyplot as plt
import torch

import mann_torch as mt
from mann_torch.control import AdaptiveLaw, ConcurrentLearning, ConstantGain, Drem, Estimator
from mann_torch.plants import Regression
from mann_torch.signals import Polynomial

plt.style.use("mann_torch.paper")

plant, truth = Regression(), [1.0, 2.0]
scenario = mt.Scenario(Polynomial([[0.0]]), plant.parameters_of(theta=truth), horizon=15.0)
recorded = ConcurrentLearning(learning_gain=1.0, size=8, period=0.25)
laws = {
    "gradient": AdaptiveLaw(ConstantGain(1.0)),
    "least squares": AdaptiveLaw(mt.control.LeastSquares(10.0)),
    "with forgetting": AdaptiveLaw(mt.control.LeastSquares(10.0, forgetting=0.5, gain_bound=100.0)),
    "DREM": Drem(mixing_gain=10.0, mixing_filter=0.95),
    "concurrent learning": AdaptiveLaw(ConstantGain(1.0), recorded),
}
figure, (left, right) = plt.subplots(1, 2, figsize=(6.4, 2.9), width_ratios=[1, 1.2])
left.plot(*truth, "k*", ms=9)
for name, law in laws.items():
    with torch.no_grad():
        run = mt.rollout(mt.ClosedLoop(plant, Estimator(law)), scenario, mt.RungeKutta(5e-3))
    theta = run.states.controller.theta[..., 0]  # (K, 2)
    left.plot(*theta.T)
    right.semilogy(run.sample_t, (theta - torch.tensor(truth)).norm(dim=-1), label=name)
left.set(xlabel="$θ_1$", ylabel="$θ_2$", aspect="equal")
right.set(xlabel="t [s]", ylabel="|error of θ|", ylim=(1e-8, 5))
figure.legend(*right.get_legend_handles_labels(), loc="outside upper center", ncols=3)
plt.show()
