"""
Tuning along a Pareto front
===========================

Every constant of a controller has a gradient through the whole rollout, so that tracking can be
bought as cheaply as possible: least SRMSE under a limit on what the motors feel, the RMS rate of
the torque, with noise on all that is measured. Grey: 600 random settings of four constants, rolled
out as one batch. Each line is one tuner on its way from the defaults (black) under a limit of its
own.
"""

import matplotlib.pyplot as plt
import torch

import mann_torch as mt
from mann_torch.tuning import Coordinates, Ensemble, GradientSettings, Objective, Schedule, Tuner

plt.style.use("mann_torch.paper")

memory = mt.WorkingMemory(n_slots=5, n_hidden=10, attention=mt.ReallocatingAttention("initial"))
controller = mt.MannController(2, n_hidden=10, memory=memory)
loop = mt.ClosedLoop(mt.TwoLinkArm(), controller)
scenario = mt.Scenario(
    mt.Sinusoid([1.0, 0.0], frequency=0.5),
    mt.arm_parameters(),
    horizon=12.0,
    schedule={"masses": mt.PiecewiseConstant([5.0], [[0.8, 2.3], [1.1, 3.3]])},
    noise=mt.MeasurementNoise([1e-3, 1e-2]),  # [rad], [rad/s]
)
weights = controller.initial_weights((2,), torch.Generator().manual_seed(0))
members = mt.Scenario.stack([scenario] * 2)
ensemble = Ensemble(loop, members, weights, mt.Implicit(), effort_after=1.0)
constants = Coordinates(controller, ["error_gain", "base_gain", "robust_gain", "rate_W"])

(figure, ax), N = plt.subplots(figsize=(5.6, 3.2)), 600
z = 3.0 * torch.rand(N, constants.size, generator=torch.Generator().manual_seed(1)).double() - 1.5
found = ensemble.scores(constants.values(z.unsqueeze(-2)))  # of (N, 2) rollouts
ax.scatter(found.rate.mean(-1), found.srmse.mean(-1), 5, "0.75", lw=0, label=f"{N} settings")
for limit in (0.5, 0.75, 1.0, 1.5):
    aim, schedule = Objective(rate_limit=limit, peak_limit=None), Schedule(30, rate=0.15)
    tuner = Tuner(ensemble, constants, aim, GradientSettings("plain"), schedule)
    while not tuner.done:
        tuner.step()
    way = torch.tensor([[0.0] * constants.size] + [row["z"] for row in tuner.history]).double()
    found = ensemble.scores(constants.values(way.unsqueeze(-2)))
    rate, error = found.rate.mean(-1), found.srmse.mean(-1)
    (line,) = ax.plot(rate, error, "-", lw=0.8)
    ax.plot(rate[-1], error[-1], "*", ms=10, c=line.get_color(), label=f"rate ≤ {limit} × start")
ax.plot(rate[0], error[0], "ko", label="start")
ax.set(xscale="log", yscale="log", xlabel="RMS torque rate [N m/s]", ylabel="SRMSE [rad]")
ax.legend(loc="center left", bbox_to_anchor=(1.0, 0.5))
plt.show()
