"""
Rohrs' counterexample
=====================

MRAC that is proved for a plant of first order, ``2/(s + 1)``, meets one with two fast poles that
nobody modelled, ``229/(s² + 30 s + 229)``. The sine in the command excites them where the phase is
-180 degrees: the gain k_y drifts until the loop is unstable, and the output bursts. A leak, ``-σ
θ``, or a bound on the gains holds it. Rohrs, Valavani, Athans and Stein 1985; Ioannou and Kokotović
1983.
"""

import matplotlib.pyplot as plt
import torch

import mann_torch as mt
from mann_torch.control import AdaptiveLaw, ConstantGain, Identity, LinearNetwork, OutputMrac
from mann_torch.plants import RohrsPlant

plt.style.use("mann_torch.paper")

plant = RohrsPlant()
command = mt.Sinusoid([1.85], frequency=16.1, offset=[0.3])
scenario = mt.Scenario(command, plant.parameters_of(), horizon=25.0)
laws = {
    "MRAC": AdaptiveLaw(ConstantGain(1.0)),
    "σ-modification, σ = 0.2": AdaptiveLaw(ConstantGain(1.0), mt.control.SigmaModification(0.2)),
    "projection, $|θ| ≤ 3$": AdaptiveLaw(ConstantGain(1.0), mt.control.Projection(bound=3.0)),
}
figure, (left, right) = plt.subplots(1, 2, figsize=(6.4, 2.8))
for name, law in laws.items():
    network = LinearNetwork(Identity(2), 1, law, start=[[-0.65], [1.14]])  # k_y, k_r
    loop = mt.ClosedLoop(plant, OutputMrac(network=network), model=mt.LinearModel.first_order(3.0))
    with torch.no_grad():
        run = mt.rollout(loop, scenario, mt.RungeKutta(1e-3), divergence_limit=1e3)
    print(f"{name}: {run.describe_status()[0]}")
    gains = run.states.controller.adaptive.network.W[..., 0]
    left.plot(run.t, run.output[:, 0], lw=0.6)
    right.plot(run.sample_t, gains[:, 0], label=name)
limit = 7800 / 458  # beyond it u = k_y y alone is unstable, by Routh
right.axhline(-limit, color="k", lw=0.8, ls=":")
right.text(0, -limit + 0.3, "below, $u = k_y y$ is unstable", fontsize=8)
left.set(xlabel="t [s]", ylabel="y", ylim=(-4, 4))
right.set(xlabel="t [s]", ylabel="$k_y$", ylim=(-19, 1))
right.legend(loc="lower left", bbox_to_anchor=(0, 0.18))
plt.show()
