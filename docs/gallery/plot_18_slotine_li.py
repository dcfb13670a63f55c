"""
Parameters learned in motion
============================

Slotine and Li's arm is linear in four unknown parameters a. Their controller,
``τ = Y(q, q', v, v') a + K_D r`` with ``da/dt = Γ Y'r``, tracks without knowing them. Left: the
error with adaptation and without (a = 0). Right: the estimates, and what they are estimates of
(dashed). They need not get there for the error to become small: the motion does not ask for it.
Slotine and Li 1987, On the adaptive control of robot manipulators.
"""

import matplotlib.pyplot as plt
import torch

import mann_torch as mt
from mann_torch.control import AdaptiveLaw, ConstantGain, SlotineLi
from mann_torch.plants import SlotineLiArm
from mann_torch.signals import Sinusoids

plt.style.use("mann_torch.paper")

arm = SlotineLiArm()
swing = torch.tensor([30.0, 45.0]).deg2rad().double()  # times 1 - cos 2 pi t
path = Sinusoids(swing[None], 2 * torch.pi, -torch.pi / 2, offset=swing)
scenario = mt.Scenario(path, arm.parameters_of(), horizon=6.0)
gains = torch.tensor([0.03, 0.05, 0.1, 0.3], dtype=torch.float64)
figure, (left, right) = plt.subplots(1, 2, figsize=(6.4, 2.8))
for name, rate in {"adapting": gains, "without adaptation": 1e-9 * gains}.items():
    law = AdaptiveLaw(ConstantGain(rate))
    controller = SlotineLi(arm, law, error_gain=20.0, feedback=100.0)
    with torch.no_grad():
        run = mt.rollout(mt.ClosedLoop(arm, controller), scenario, mt.RungeKutta(1e-3))
    left.plot(run.t, run.error[:, 0].rad2deg(), label=name)
    if name == "adapting":
        lines = right.plot(run.sample_t, run.states.controller.estimate[..., 0])
for k, line in enumerate(lines):
    line.set_label(f"$a_{k + 1}$")
    right.axhline(scenario.parameters.a[k], color=line.get_color(), lw=0.8, ls="--")
left.set(xlabel="t [s]", ylabel="$e_1$ [deg]", ylim=(-6, 8))
right.set(xlabel="t [s]", ylabel="estimates [kg m²]", ylim=(-0.2, 4.4))
left.legend()
right.legend(ncols=4, loc="upper right")
plt.show()
