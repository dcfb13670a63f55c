"""
Deployment in MuJoCo
====================

The controller leaves the simulator it was made in: ``deploy`` makes one discrete step of it, at 1
kHz, and that step drives the arm in MuJoCo, whose equations are written by somebody else. A hand
takes 2 kg at 5 s and puts them down at 12 s (grey). Top: the joints' errors there (lines) and in
our rollout with a clock of that period (dots). Bottom: how far the two are apart, with two of
MuJoCo's integrators.
"""

import matplotlib.pyplot as plt
import torch

import mann_torch as mt
from mann_torch.simulators import arm_mjcf, arm_payloads, run_in_mujoco

plt.style.use("mann_torch.paper")

arm, horizon, period, held = mt.TwoLinkArm(), 20.0, 1e-3, [5.0, 12.0]  # [s]
payload = mt.PiecewiseConstant(held, [[0.8, 2.3], [0.8, 4.3], [0.8, 2.3]])  # [kg]
swing, body = mt.Sinusoid([1.0, 0.5], frequency=1.0), mt.arm_parameters()
scenario = mt.Scenario(swing, body, horizon, schedule={"masses": payload})
memory = mt.WorkingMemory(n_slots=5, n_hidden=10, attention=mt.ReallocatingAttention("initial"))
controller = mt.MannController(2, n_hidden=10, memory=memory)
weights = controller.initial_weights((), torch.Generator().manual_seed(0))
loop = mt.ClosedLoop(arm, controller, clock=mt.Clock(period))
with torch.no_grad():
    ours = mt.rollout(loop, scenario, weights=weights, motion_dt=period)
stepper = mt.deploy(loop)
figure, (top, bottom) = plt.subplots(2, 1, sharex=True, figsize=(6.4, 3.8))
for integrator in ("RK4", "implicitfast"):
    there = run_in_mujoco(
        stepper,
        arm_mjcf(arm, body, timestep=period, integrator=integrator),
        ["joint_1", "joint_2"],
        swing,
        horizon,
        actuators=["torque_1", "torque_2"],
        payloads=arm_payloads(arm, scenario),
        weights=weights,
    )
    apart = (there.q - ours.output).norm(dim=-1)
    bottom.semilogy(there.t[200:], 1e3 * apart[200:], lw=0.8, label=integrator)
    print(integrator, "RMS error", (100 * there.srmse / mt.srmse(ours)).numpy(), "% of ours")
top.plot(there.t, 1e3 * there.error, label=["$e_1$ in MuJoCo", "$e_2$ in MuJoCo"])
top.plot(ours.t[::400], 1e3 * ours.error[::400], "k.", ms=2.5)
top.set(ylabel="error [mrad]", ylim=(-60, 60))
bottom.set(xlabel="t [s]", ylabel="apart [mrad]")
for ax in (top, bottom):
    ax.axvspan(*held, color="0.93", lw=0, zorder=0)
    ax.legend(ncols=2)
plt.show()
