"""
What a delay costs
==================

Fast adaptation against late measurements. The textbook's MRAC of one state, ``x' = -x + u/2`` after
``x_m' = -2 x_m + 2 r``, is run with 60 adaptation gains side by side, once for each delay of a
sensor that samples at 20 Hz. The error falls with the gain up to where the loop begins to ring; the
longer the delay, the sooner. A curve ends where the loop diverges. Åström and Wittenmark 1995,
Adaptive Control, example 5.7, with a sensor.
"""

import matplotlib.pyplot as plt
import torch

import mann_torch as mt
from mann_torch.control import AdaptiveLaw, ConstantGain, Identity, LinearNetwork, Mrac
from mann_torch.plants import LinearPlant
from mann_torch.signals import SquareWave

plt.style.use("mann_torch.paper")

plant = LinearPlant(A=[[-1.0]], B=[[0.5]], C=[[1.0]])
scenario = mt.Scenario(SquareWave([1.0], period=20.0), plant.parameters_of(), horizon=100.0)
gains, shown = torch.logspace(-1.5, 2, 60, dtype=torch.float64), 100
figure, (left, right) = plt.subplots(1, 2, figsize=(6.4, 2.8))
for delay in (0, 50, 100, 200, 400):  # [ms]
    controller = Mrac([[1.0]], LinearNetwork(Identity(2), 1, AdaptiveLaw(ConstantGain(0.2))))
    loop = mt.ClosedLoop(
        plant,
        controller,
        model=mt.LinearModel([[-2.0]], [[2.0]]),
        sensor=mt.Sensor(delay=1e-3 * delay, period=0.05),
    )
    loop.initialize(adaptation_rate=gains)  # a row a sample
    with torch.no_grad():
        run = mt.rollout(loop, scenario, mt.RungeKutta(0.01), motion_dt=0.05)
    left.loglog(gains, mt.srmse(run), label=f"{delay} ms")
    if delay == shown:
        for k in (15, 33, 45):
            right.plot(run.t, run.output[:, k, 0], label=f"γ = {gains[k]:.2g}")
right.plot(run.t, run.reference.value[:, 0, 0], "k--", lw=0.8, label="model")
right.set(title=f"delay {shown} ms", xlabel="t [s]", ylabel="x", xlim=(0, 40), ylim=(-1.6, 2.6))
right.legend(ncols=2, loc="upper right")
left.set(xlabel="adaptation gain γ", ylabel="RMS error")
left.legend(title="delay")
plt.show()
