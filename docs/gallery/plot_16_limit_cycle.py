"""
A limit cycle
=============

The roll of a slender delta wing at a large angle of attack, left alone: ``x'' = W'φ(x)``, from 30
starts in one batch. From inside (blue) and from some way outside (green) it comes to the same
oscillation, wing rock; from farther out (orange) the roll departs. A sample that leaves the finite
range is held there, and does not disturb its mates. Elzebda, Nayfeh and Mook 1989.
"""

import matplotlib.pyplot as plt
import torch

import mann_torch as mt
from mann_torch.plants import ELZEBDA, RowState, WingRock
from mann_torch.signals import Polynomial

plt.style.use("mann_torch.paper")

wing = WingRock()
turn = torch.linspace(0.0, 2 * torch.pi, 29, dtype=torch.float64)[:-1]
circle = torch.stack([1.3 * turn.cos(), 0.16 * turn.sin()], dim=-1)  # [rad], [rad/s]
start = RowState(torch.cat([circle[::14] / 4, circle]))
scenario = mt.Scenario(
    Polynomial([[0.0]]), wing.parameters_of(weights=list(ELZEBDA)), horizon=600.0, start=start
)
loop = mt.ClosedLoop(wing, mt.LinearFeedback([[0.0, 0.0]]))
with torch.no_grad():
    run = mt.rollout(loop, scenario, mt.RungeKutta(0.02), motion_dt=0.2, divergence_limit=5.0)
print(f"amplitude of the limit cycle: {run.output[run.t > scenario.end - 50.0, 0].max():.4f} rad")
figure, (left, right) = plt.subplots(1, 2, figsize=(6.4, 2.9))
for k, failed in enumerate(run.status):
    colour = "C1" if failed else "C0" if k < 2 else "C2"
    left.plot(*run.plant.x[:, k].T, color=colour, lw=0.5)
    if not failed and k % 15 in (0, 1):
        right.plot(run.t, run.output[:, k], color=colour, lw=0.7)
left.plot(*start.x.T, "k.", ms=3)
left.set(xlabel="roll [rad]", ylabel="roll rate [rad/s]", xlim=(-2, 2), ylim=(-0.3, 0.3))
right.set(xlabel="t [s]", ylabel="roll [rad]", xlim=(0, scenario.end))
plt.show()
