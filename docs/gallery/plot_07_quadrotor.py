"""
A quadrotor in wind
===================

A planar quadrotor flies a loop in a wind that its controller does not know of. With one constant
feature adaptation is integral action. With ``W'tanh(V_2 tanh(V_1 z))``, z = (q, dq/dt), it can
learn the air's drag, the better the more its features are made for it: Adam moves V, by
backpropagation through whole flights in six winds of 1 to 6 m/s (grey). Richards, Azizan, Slotine
and Pavone 2021, Adaptive-control-oriented meta-learning, arXiv 2103.04490.
"""

import matplotlib.pyplot as plt
import torch

import mann_torch as mt
from mann_torch.control import AdaptiveLaw, Constant, ConstantGain, Layers, LinearNetwork
from mann_torch.plants import PlanarQuadrotor
from mann_torch.signals import Polynomial, Sinusoids

plt.style.use("mann_torch.paper")

drone, law, met = PlanarQuadrotor(), AdaptiveLaw(ConstantGain(1.0)), torch.arange(1.0, 7.0)
path = Sinusoids([[2.0, 1.5, 0.2]], torch.pi / 3, [[0.0, -torch.pi / 2, 0.0]], [0.0, 1.5, 0.0])
start = mt.PlantState(*path(torch.tensor(0.0, dtype=torch.float64))[:2])
believed = drone.parameters_of(drag=[0.0, 0.0])
gains = {"error_gain": 1.0, "feedback": 5.0, "drive_gain": 10.0}


def flight(basis, winds):
    """One flight of 6 s in each of the winds [m/s], as one batch."""
    network = LinearNetwork(basis, 3, law)
    controller = mt.control.MetaAdaptive(network, drone, believed, **gains)
    wind = mt.Disturbance(plant=Polynomial(winds.double()[:, None, None]))
    scenario = mt.Scenario(path, drone.parameters_of(), 6.0, start=start, disturbance=wind)
    return mt.rollout(mt.ClosedLoop(drone, controller), scenario, mt.RungeKutta(0.01))


learned = Layers.random(6, 16, layers=2, seed=0)
optimizer = torch.optim.Adam(learned.tune(*learned.constants()), lr=0.02)
for _ in range(60):
    loss = mt.srmse(flight(learned, met)).square().sum(-1).mean()
    optimizer.zero_grad()
    loss.backward()
    optimizer.step()
figure, (left, right) = plt.subplots(1, 2, figsize=(6.4, 2.9))
winds, shown = torch.linspace(0.0, 10.0, 41), 32  # [m/s], and which of them
bases = {"integral": Constant(6), "random features": Layers.random(6, 16, 2, 0), "learned": learned}
for name, basis in bases.items():
    with torch.no_grad():
        run = flight(basis, winds)
    left.plot(*run.output[:, shown, :2].T)
    right.semilogy(winds, 1e3 * mt.srmse(run)[:, :2].norm(dim=-1), label=name)
left.plot(*run.reference.value[:, shown, :2].T, "k--", lw=0.8)
left.set(title=f"wind of {winds[shown]:g} m/s", xlabel="x [m]", ylabel="y [m]", aspect="equal")
right.axvspan(met[0], met[-1], color="0.93", lw=0, zorder=0)
right.set(xlabel="wind [m/s]", ylabel="SRMSE of position [mm]")
right.legend()
plt.show()
