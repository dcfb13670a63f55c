"""
Work and precision
==================

How far a rollout's angles are off for a step, by solver: 10 s of the paper's arm under its network
controller, against a fine step of the classical Runge-Kutta method. The loop is stiff (the robust
gain pulls at the joints' rates): beyond a step of some milliseconds the explicit method diverges,
and its line ends. The linearly implicit one goes on, and is more accurate with the reference's
motion in its stages.
"""

import matplotlib.pyplot as plt
import torch

import mann_torch as mt

plt.style.use("mann_torch.paper")

controller = mt.MannController(2, n_hidden=10)
loop = mt.ClosedLoop(mt.TwoLinkArm(), controller)
swing = mt.Sinusoid([1.0, 0.0], frequency=0.5)
scenario = mt.Scenario(swing, mt.arm_parameters(), horizon=10.0)
weights = controller.initial_weights((), torch.Generator().manual_seed(0))
solvers = {
    "Runge-Kutta 4": mt.RungeKutta,
    "implicit": lambda dt: mt.Implicit(dt, follow_reference=False),
    "implicit, reference in its stages": mt.Implicit,
}


def run(solver):
    """Angles every 0.1 s."""
    with torch.no_grad():
        return mt.rollout(loop, scenario, solver, weights=weights, motion_dt=0.1)


exact = run(mt.RungeKutta(2e-4)).output
figure, ax = plt.subplots(figsize=(5.2, 3.2))
steps = [5e-4, 1e-3, 2e-3, 5e-3, 1e-2, 2e-2]  # [s]
for name, make in solvers.items():
    found = [(dt, run(make(dt))) for dt in steps]
    good = [(dt, (one.output - exact).abs().amax()) for dt, one in found if not one.status]
    ax.loglog(*zip(*good, strict=True), "o-", label=name)
ax.set(xlabel="step [s]", ylabel="largest error of an angle [rad]")
ax.legend()
plt.show()
