r"""
An input that saturates
=======================

``x' = x + sat(u)`` with \|u\| ≤ 10 can be held only where \|x\| < 10, and this plant starts at
-9.99. The plain law takes the error that the limit makes for one of its own and winds its gain up;
with the augmented error, ``e = x_m + e_d - x``, what the limit did is taken from the law, the gain
stays, and the plant comes back to its model. Karason and Annaswamy 1994, Adaptive control in the
presence of input constraints.
"""

import matplotlib.pyplot as plt
import torch

import mann_torch as mt
from mann_torch.control import AdaptiveLaw, AugmentedError, ConstantGain, Identity, LinearNetwork
from mann_torch.plants import LinearPlant, RowState

plt.style.use("mann_torch.paper")

limit, plant = 10.0, LinearPlant(A=[[1.0]], B=[[1.0]], C=[[1.0]])
start = RowState(torch.tensor([-9.99], dtype=torch.float64))
command = mt.Sinusoid([5.0], frequency=0.5)
scenario = mt.Scenario(command, plant.parameters_of(), horizon=10.0, start=start)
kinds = {
    "augmented error": AugmentedError([[-1.0]], [[1.0]], input_limit=[limit]),
    "unprotected": None,
}
figure, axes = plt.subplots(1, 3, figsize=(6.4, 2.6))
for name, saturation in kinds.items():
    network = LinearNetwork(Identity(2), 1, AdaptiveLaw(ConstantGain(0.1)), [[-2.2], [1.1]])
    loop = mt.ClosedLoop(
        plant,
        mt.control.Mrac([[1.0]], network, saturation=saturation),
        model=mt.LinearModel([[-1.0]], [[1.0]], start=[-9.9]),
        actuator=mt.Actuator(1, limit=limit),
    )
    with torch.no_grad():
        run = mt.rollout(loop, scenario, mt.RungeKutta(2e-3))
    seen = mt.observe(loop, scenario, run)
    axes[0].plot(run.t, run.output[:, 0], label=name)
    axes[1].plot(run.sample_t, seen.applied[:, 0])
    axes[2].plot(run.sample_t, run.states.controller.adaptive.network.W[:, 0, 0])
axes[0].plot(run.t, run.reference.value[:, 0], "k--", lw=0.8, label="model")
for ax, label in zip(axes, ("x", "sat(u)", "gain on x"), strict=True):
    ax.set(xlabel="t [s]", ylabel=label)
figure.legend(*axes[0].get_legend_handles_labels(), loc="outside upper center", ncols=3)
plt.show()
