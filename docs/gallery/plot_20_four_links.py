"""
Four links, one drawing
=======================

The same controller on a longer arm: four links of 0.5 m go from one pose to another and back by a
minimum-jerk path, with nothing known of masses or gravity. Left: the arm every 50 ms of the first
move. Right: the joints' errors while a network with a memory learns: the first second, from
nothing, is the worst. Flash and Hogan 1985 for the path, Lagrange for the arm.
"""

import matplotlib.pyplot as plt
import torch

import mann_torch as mt
from mann_torch.plants import NLinkArm
from mann_torch.signals import MinimumJerk

plt.style.use("mann_torch.paper")

length, move = 0.5, 2.0  # of a link [m], [s]
poses = torch.tensor([[-1.2, 0.9, 0.9, 0.9], [2.6, -0.6, -0.9, -1.2]], dtype=torch.float64)  # [rad]
n, arm = poses.shape[1], NLinkArm(poses.shape[1])
times = (move * torch.arange(9.0)).tolist()
path = MinimumJerk(times, poses.repeat(5, 1)[: len(times)])
rest = mt.PlantState(poses[0], torch.zeros(n, dtype=torch.float64))
scenario = mt.Scenario(path, arm.parameters_of(lengths=[length] * n), horizon=times[-1], start=rest)
memory = mt.WorkingMemory(n_slots=5, n_hidden=20, attention=mt.ReallocatingAttention("initial"))
loop = mt.ClosedLoop(arm, mt.MannController(n, n_hidden=20, memory=memory))
with torch.no_grad():
    run = mt.rollout(loop, scenario, generator=torch.Generator().manual_seed(0), motion_dt=0.01)
late = 1e3 * mt.srmse(run, after=move)
print(f"RMS error after {move:g} s [mrad]:", late.numpy().round(1))
figure, (left, right) = plt.subplots(1, 2, figsize=(6.4, 3.2), width_ratios=[1, 1.3])
angles = run.q[run.t <= move][::5].cumsum(-1)
for k, angle in enumerate(angles):
    x, y = length * angle.cos().cumsum(-1), length * angle.sin().cumsum(-1)
    colour = plt.colormaps["cividis"](k / len(angles))
    left.plot([0, *x], [0, *y], "-o", color=colour, ms=2, lw=0.9)
right.plot(run.t, 1e3 * run.error, lw=0.8, label=[f"$e_{k + 1}$" for k in range(n)])
left.set(xlabel="x [m]", ylabel="y [m]", aspect="equal")
right.set(xlabel="t [s]", ylabel="error [mrad]")
right.legend(ncols=n, loc="upper right")
plt.show()
