"""
Attention at work
=================

What the memory of the first example does. Top: the slot that is read, one of five; attention takes
the nearest, ``argmin_i |σ - μ_i|``, and while slots are unused a new one begins (red) where none is
nearer than θ. Middle: the contents of all slots, ``dμ/dt = w_r (c_w σ + W h_e' - μ)``, which only
the slot that is read changes (it may be for less than a pixel). Bottom: the error. Dotted: the
arm's masses jump.
"""

import matplotlib.pyplot as plt
import torch

import mann_torch as mt

plt.style.use("mann_torch.paper")

S, horizon, jumps = 5, 60.0, [10.0, 20.0, 40.0]  # slots, [s], [s]
masses = mt.PiecewiseConstant(jumps, [[0.8, 2.3], [1.6, 4.6], [2.3, 6.5], [1.6, 4.6]])  # [kg]
scenario = mt.Scenario(
    mt.Sinusoid([1.0, 0.0], frequency=0.5),
    mt.arm_parameters(lengths=[1.0, 2.0]),
    horizon=horizon,
    schedule={"masses": masses},
)
memory = mt.WorkingMemory(n_slots=S, n_hidden=10, attention=mt.ReallocatingAttention("initial"))
loop = mt.ClosedLoop(mt.TwoLinkArm(), mt.MannController(2, n_hidden=10, memory=memory))
with torch.no_grad():
    run = mt.rollout(loop, scenario, generator=torch.Generator().manual_seed(0))
weights = mt.observe(loop, scenario, run).signals.weights  # (K, S)
begun = run.modes.reallocations.diff().nonzero()[:, 0] + 1
print("slots begin at", run.sample_t[begun].numpy().round(2), "s")

figure, (top, middle, bottom) = plt.subplots(3, 1, sharex=True, figsize=(6.4, 4.4))
contents = run.states.controller.memory.mu.flatten(1)  # (K, S of 10)
look = {"aspect": "auto", "extent": (0, horizon, 0.5, S + 0.5), "interpolation": "nearest"}
read = top.imshow(weights.T, "Blues", origin="lower", **look)
written = middle.imshow(contents.T, origin="lower", **look)
figure.colorbar(read, ax=top, label="$w_r$")
figure.colorbar(written, ax=middle, label=r"$\mu$")
top.plot(run.sample_t[begun], weights[begun].argmax(-1) + 1, "o", color="tab:red", ms=3)
for slot in range(1, S):
    middle.axhline(slot + 0.5, color="w", lw=0.8)
bottom.plot(run.t, 1e3 * run.error, label=["$e_1$", "$e_2$"])
bottom.set(xlabel="t [s]", ylabel="error [mrad]", ylim=(-45, 45), xlim=(0, horizon))
bottom.set_yticks([-30, 0, 30])
top.set(ylabel="slot", yticks=range(1, S + 1))
middle.set(ylabel="slot", yticks=range(1, S + 1))
bottom.legend(loc="upper right", ncols=2)
for ax in (top, middle, bottom):
    for jump in jumps:
        ax.axvline(jump, color="0.3", lw=0.6, ls=":")
plt.show()
