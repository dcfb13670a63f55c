"""
A gradient landscape
====================

Left: what a tuner sees of two constants, Λ and k_v: tracking error plus half the torque's rate,
both relative to the defaults (dot). Arrows are downhill, by backpropagation through each rollout.
Right: where a gradient has to be read with care. Under hard attention the slots that are read
depend on c_w, and the error jumps from branch to branch: the plain slope is that of the branch it
is on, ``smoothed`` that of a straight line through what lies within ± 13 %.
"""

import matplotlib.pyplot as plt
import torch

import mann_torch as mt
from mann_torch.tuning import Coordinates, Ensemble, GradientSettings, score, slope_of

plt.style.use("mann_torch.paper")

C_W, LAMBDA, K_V, N = 0.66, 5.0, 10.0, 13  # in the middle; N by N settings, N odd
memory = mt.WorkingMemory(n_slots=5, n_hidden=10, attention=mt.HardAttention(), write_gain=C_W)
controller = mt.MannController(2, n_hidden=10, memory=memory)
loop = mt.ClosedLoop(mt.TwoLinkArm(), controller)
jump = {"masses": mt.PiecewiseConstant([5.0], [[0.8, 2.3], [1.1, 3.3]])}  # [s], [kg]
scenario = mt.Scenario(mt.Sinusoid([1.0, 0.0], 0.5), mt.arm_parameters(), 30.0, schedule=jump)
weights = controller.initial_weights((1,), torch.Generator().manual_seed(0))
side, eye = torch.linspace(-1.2, 1.2, N).double(), torch.eye(2).double()
x, y = torch.cartesian_prod(side, side).T  # logarithms of Λ and k_v over their defaults
controller.initialize(error_gain=LAMBDA * x.exp()[:, None, None] * eye, robust_gain=K_V * y.exp())
free = controller.tune("error_gain", "robust_gain")
found = score(mt.rollout(loop, scenario, weights=weights, motion_dt=30.0, effort_after=1.0))
start = mt.trees.map_tensors(lambda part: part[N * N // 2].detach(), found)  # the defaults
cost = found.srmse / start.srmse + 0.5 * found.rate / start.rate
cost.log2().sum().backward()
down = [-(p * p.grad).detach().reshape(N, N, -1).sum(-1)[::2, ::2].T for p in free]

figure, (left, right) = plt.subplots(1, 2, figsize=(6.4, 2.9))
image = left.contourf(side, side, cost.log2().detach().reshape(N, N).T, 14)
figure.colorbar(image, ax=left, label="log₂ cost")
left.quiver(side[::2], side[::2], *down, color="w", width=0.007)
left.plot(0, 0, "wo")
left.set(xlabel=f"ln Λ / {LAMBDA:g}", ylabel=f"ln $k_v$ / {K_V:g}")

controller.initialize(error_gain=LAMBDA * eye, robust_gain=K_V)
ensemble = Ensemble(loop, mt.Scenario.stack([scenario]), weights, mt.Implicit())
constant, z = Coordinates(loop, ["write_gain"]), torch.linspace(-0.25, 0.25, 201).double()
error = ensemble.scores(constant.values(z[:, None, None])).srmse[:, 0]
right.plot(C_W * z.exp(), 1e3 * error, lw=0.9)
for mode, colour in {"plain": "C1", "smoothed": "C2"}.items():
    how = GradientSettings(mode, design="each", pairs=9)
    slope = slope_of(ensemble, constant, 0 * z[:1], lambda run: score(run).srmse, how)
    middle = error[len(z) // 2] if mode == "plain" else slope.value
    right.plot(C_W * z.exp(), 1e3 * (middle + slope.mean * z), color=colour, label=mode)
right.set(xlabel="$c_w$", ylabel="SRMSE [mrad]")
right.legend()
plt.show()
