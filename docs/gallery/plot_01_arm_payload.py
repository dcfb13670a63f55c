"""
An arm that picks up a payload
==============================

A two-link arm swings, and both masses double for a while (grey), as where a load is taken and put
down. A network of ten neurons learns the torques online; beside it the same with a working memory
of five slots whose read h_o is added to the features, ``τ = W'(σ(V'x̃) + h_o) + ...``, of "Improved
Attention Models for Memory Augmented Neural Network Adaptive Controllers". Left: the arm every 0.1
s of half a swing, the load on it. Right: what the load does to the error.
"""

import matplotlib.pyplot as plt
import torch

import mann_torch as mt

plt.style.use("mann_torch.paper")

horizon, loaded = 50.0, [15.0, 35.0]  # [s]
masses = mt.PiecewiseConstant(loaded, [[0.8, 2.3], [1.6, 4.6], [0.8, 2.3]])  # [kg]
scenario = mt.Scenario(
    mt.Sinusoid([1.0, 0.5], frequency=0.5),
    mt.arm_parameters(lengths=[1.0, 1.0]),
    horizon=horizon,
    schedule={"masses": masses},
)
memory = mt.WorkingMemory(n_slots=5, n_hidden=10, attention=mt.ReallocatingAttention("initial"))
controllers = {
    "network alone": mt.MannController(n_joints=2, n_hidden=10),
    "with memory": mt.MannController(n_joints=2, n_hidden=10, memory=memory),
}
figure = plt.figure(figsize=(6.4, 3.0))
axes = figure.subplot_mosaic([["arm", "e1"], ["arm", "e2"]], width_ratios=[1, 1.7])
for name, controller in controllers.items():
    loop = mt.ClosedLoop(mt.TwoLinkArm(), controller)
    weights = torch.Generator().manual_seed(0)
    with torch.no_grad():
        run = mt.rollout(loop, scenario, generator=weights, batch_shape=(8,), motion_dt=0.02)
    print(f"{name}: RMS error {(1e3 * mt.srmse(run, after=10.0).mean(0)).numpy()} mrad")
    for joint in (0, 1):
        axes[f"e{joint + 1}"].plot(run.t, 1e3 * run.error[:, 0, joint], label=name)
angles = run.q[(run.t > 22.0) & (run.t < 28.3), 0][::5].cumsum(-1)  # of each link, absolute
for k, (x, y) in enumerate(zip(angles.cos().cumsum(-1), angles.sin().cumsum(-1), strict=True)):
    colour = plt.colormaps["cividis"](k / len(angles))
    axes["arm"].plot([0, *x], [0, *y], "-o", color=colour, ms=2.5, lw=0.9)
axes["arm"].set(xlabel="x [m]", ylabel="y [m]", aspect="equal")
for joint in (1, 2):
    ax = axes[f"e{joint}"]
    ax.axvspan(*loaded, color="0.93", zorder=0, lw=0)
    ax.set(xlim=(0, horizon), ylim=(-40, 60), ylabel=f"$e_{joint}$ [mrad]")
axes["e1"].tick_params(labelbottom=False)
axes["e2"].set_xlabel("t [s]")
axes["e1"].legend(loc="upper right", ncols=2)
plt.show()
