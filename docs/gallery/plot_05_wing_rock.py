"""
Wing rock, and learning from stored data
========================================

The roll of a slender delta wing, ``x'' = u + W*'φ(x)``, is to follow a model of second order. MRAC,
``dW/dt = Γ φ e'PB``, keeps the error small and learns little of the moment: a few steps of the
command do not excite it. With twenty recorded points replayed at every instant the same law finds
all six weights, and no step disturbs it any more. Chowdhary and Johnson 2010, Concurrent learning
for convergence in adaptive control.
"""

import matplotlib.pyplot as plt
import torch

import mann_torch as mt
from mann_torch.control import AdaptiveLaw, ConcurrentLearning, ConstantGain, FunctionBasis
from mann_torch.plants import CHOWDHARY_JOHNSON, RowState, WingRock
from mann_torch.signals import Steps

plt.style.use("mann_torch.paper")

wing = WingRock(accelerometer=True)
A, B = [[0.0, 1.0], [-1.0, -1.0]], [[0.0], [1.0]]
basis = FunctionBasis(lambda z: WingRock.basis(z[..., :2]), n_inputs=3, n_features=6)
start = torch.tensor([2.0, 2.0], dtype=torch.float64)  # [rad], [rad/s]
commands = Steps([5.0, 10.0, 20.0, 25.0, 35.0, 40.0, 50.0], [[0.0], [1.0]] * 4)
scenario = mt.Scenario(commands, wing.parameters_of(), 60.0, start=RowState(start))
recorded = ConcurrentLearning(learning_gain=0.05, size=20, period=0.5)
laws = {
    "MRAC": AdaptiveLaw(ConstantGain(10.0)),
    "with recorded data": AdaptiveLaw(ConstantGain(10.0), recorded),
}
known = {"feedback": [[1.0, 1.0]], "feedforward": [[1.0]], "error_feedback": [[0.2, 0.2]]}
figure, (left, right) = plt.subplots(1, 2, figsize=(6.4, 2.8))
for name, law in laws.items():
    network = mt.control.LinearNetwork(basis, 1, law)
    controller = mt.control.Mrac.of_model(
        A, B, network, labels=mt.control.MeasuredLabels("moment"), **known
    )
    loop = mt.ClosedLoop(wing, controller, model=mt.LinearModel(A, B, [[1.0, 0.0]], start=start))
    with torch.no_grad():
        run = mt.rollout(loop, scenario, mt.RungeKutta(2e-3))
    left.plot(run.t, 1e3 * run.error[:, 0], label=name)
    estimates = -run.states.controller.adaptive.network.W[..., 0]  # the law learns what u needs
    distance = (estimates - torch.tensor(CHOWDHARY_JOHNSON)).norm(dim=-1)
    right.semilogy(run.sample_t, distance, label=name)
    print(f"{name}: |W - W*| = {distance[-1]:.2e} after {scenario.end:g} s")
left.set(xlabel="t [s]", ylabel="roll error [mrad]", ylim=(-130, 60))
right.set(xlabel="t [s]", ylabel="$|W - W^*|$ [1/s²]")
left.legend()
plt.show()
