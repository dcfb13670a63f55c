"""
Ten thousand runs
=================

The same controller on 10,000 arms: masses spread by 30 %, lengths by 15 %, every run with initial
weights of its own, and a payload of up to 3 kg at 6 s. One call, one batch, spread over the cores;
a run's bits depend on neither. Left and middle: quantiles of the error over time. Right: how the
runs' errors are spread, without and with the working memory.
"""

import matplotlib.pyplot as plt
import torch

import mann_torch as mt

plt.style.use("mann_torch.paper")

N, taken = 10_000, 6.0  # runs, [s]
random = torch.Generator().manual_seed(0)
normal = torch.randn(N, 4, generator=random, dtype=torch.float64)
masses = torch.tensor([0.8, 2.3]) * (0.3 * normal[:, :2]).exp()
lengths = (0.15 * normal[:, 2:]).exp()
loads = torch.rand(N, 1, generator=random, dtype=torch.float64) * torch.tensor([0.0, 3.0])
jumps = torch.full((N, 1), taken)
payload = mt.PiecewiseConstant(jumps.double(), torch.stack([masses, masses + loads], dim=1))
scenario = mt.Scenario(
    mt.Sinusoid([1.0, 0.5], frequency=0.5),
    mt.arm_parameters(masses=masses, lengths=lengths),
    horizon=12.0,
    schedule={"masses": payload},
)
memory = mt.WorkingMemory(n_slots=5, n_hidden=10, attention=mt.ReallocatingAttention("initial"))
kept = {"generator": random, "batch_shape": (N,), "motion_dt": 0.1, "sample_until": 0.0}
figure, axes = plt.subplots(1, 3, figsize=(6.4, 2.6), width_ratios=[1, 1, 1.1])
for k, (name, part) in enumerate({"network alone": None, "with memory": memory}.items()):
    loop = mt.ClosedLoop(mt.TwoLinkArm(), mt.MannController(2, n_hidden=10, memory=part))
    with torch.no_grad():
        run = mt.rollout(loop, scenario, **kept)
    print(f"{name}: {int(run.status.count_nonzero())} of {N} runs diverged")
    size = 1e3 * run.error.norm(dim=-1)  # (T, N) [mrad]
    levels = torch.tensor([0.05, 0.25, 0.5, 0.75, 0.95], dtype=torch.float64)
    low, lower, middle, upper, high = size.quantile(levels, dim=1)
    axes[k].fill_between(run.t, low, high, color=f"C{k}", alpha=0.25, lw=0, label="5 to 95 %")
    axes[k].fill_between(run.t, lower, upper, color=f"C{k}", alpha=0.5, lw=0, label="25 to 75 %")
    axes[k].semilogy(run.t, middle, color=f"C{k}", lw=0.8, label="median")
    axes[k].set(title=name, xlabel="t [s]", ylim=(0.3, 1000))
    error = 1e3 * mt.srmse(run, after=taken).norm(dim=-1)
    axes[2].hist(error, bins=torch.linspace(0, 50, 51), histtype="step", label=name)
axes[0].set_ylabel("|e| [mrad]")
axes[0].legend(loc="upper right")
axes[2].set(xlabel=f"SRMSE after {taken:g} s [mrad]", ylabel="runs", ylim=(0, 1400))
axes[2].legend()
plt.show()
