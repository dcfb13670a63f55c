r"""
A law of one's own
==================

Noise keeps the estimates of the plain gradient law moving: they chase what no estimate can take
away. The usual remedy is a dead zone, which learns nothing where \|s\| < d; this one is smooth, a
gate that lets through the share ``s²/(s² + d²)`` of every error. It takes nine lines, is put
through ``check_law``, and is compiled with the rest of the loop. Plant: ``x' = x + u``, after
``x_m' = -x_m + r``.
"""

import matplotlib.pyplot as plt
import torch

import mann_torch as mt
from mann_torch.control import AdaptiveLaw, ConstantGain, Gate, Identity, LinearNetwork, Mrac
from mann_torch.domains import NonNegative
from mann_torch.plants import LinearPlant
from mann_torch.signals import SquareWave
from mann_torch.testing import check_law

plt.style.use("mann_torch.paper")


class SmoothDeadZone(Gate):
    """Of an error s only s³/(s² + d²) drives."""

    def __init__(self, width):
        super().__init__()
        self.declare("width", width, NonNegative())

    def forward(self, drive):
        s, d = drive.error, self.width[..., None, None]
        return drive._replace(error=s * s * s / (s * s + d * d + 1e-12))


check_law(AdaptiveLaw(SmoothDeadZone(0.1)))
plant = LinearPlant(A=[[1.0]], B=[[1.0]], C=[[1.0]])
scenario = mt.Scenario(
    SquareWave([1.0], period=10.0),
    plant.parameters_of(),
    horizon=200.0,
    noise=mt.MeasurementNoise([0.1], rate=50.0),
)
figure, (left, right) = plt.subplots(1, 2, figsize=(6.4, 2.8))
for name, gates in {"gradient law": (), "smooth dead zone": (SmoothDeadZone(0.4),)}.items():
    network = LinearNetwork(Identity(2), 1, AdaptiveLaw(ConstantGain(5.0), *gates))
    loop = mt.ClosedLoop(plant, Mrac([[1.0]], network), model=mt.LinearModel([[-1.0]], [[1.0]]))
    with torch.no_grad():
        run = mt.rollout(loop, scenario, mt.RungeKutta(0.01))
    left.plot(run.sample_t, run.states.controller.adaptive.network.W[:, 0, 0], label=name)
    late = run.t > scenario.end - 20.0
    right.plot(run.t[late], run.output[late, 0], lw=0.8)
right.plot(run.t[late], run.reference.value[late, 0], "k--", lw=0.8, label="model")
left.set(xlabel="t [s]", ylabel="gain on x", ylim=(-3, 0.2))
right.set(xlabel="t [s]", ylabel="x")
left.legend()
right.legend()
plt.show()
