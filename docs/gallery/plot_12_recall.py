"""
Recall from a working memory
============================

Five pairs of a key and a value are shown, then each key alone: which value came with it? The memory
cell learns it in some hundred iterations; an LSTM of about as many parameters does not in these
300. Left: accuracy on the way, on batches not seen before. Right: the slots that are read at the
five questions of a new sequence, and the slot that was written when the pair was shown (cross).
"""

import matplotlib.pyplot as plt
import torch
from torch import nn
from torch.nn.functional import cross_entropy, one_hot

from mann_torch.memory import MemoryCell, MemorySequence

plt.style.use("mann_torch.paper")

P, K, S, ITERATIONS = 5, 8, 8, 300  # pairs, of so many keys and values; slots


def batch(count):
    """Inputs (2P, count, 2K + 1) and what is to be answered (P, count)."""
    keys, values = torch.rand(count, K).argsort(-1)[:, :P].T, torch.randint(K, (P, count))
    order = torch.rand(P, count).argsort(0)
    x = torch.zeros(2 * P, count, 2 * K + 1)
    x[:P, :, :-1] = torch.cat([one_hot(keys, K), one_hot(values, K)], dim=-1)
    x[P:, :, :K], x[P:, :, -1] = one_hot(keys.gather(0, order), K), 1.0
    return x, values.gather(0, order)


torch.manual_seed(0)
memory = MemorySequence(MemoryCell(2 * K + 1, 32, n_slots=S, output_size=K))
figure, (left, right) = plt.subplots(1, 2, figsize=(6.4, 2.8))
for name, model in {"memory": memory, "LSTM": nn.LSTM(2 * K + 1, 28)}.items():
    optimizer, hits = torch.optim.Adam(model.parameters(), lr=1e-2), torch.zeros(ITERATIONS)
    for n in range(ITERATIONS):
        x, answer = batch(32)
        scores = model(x)[0][P:, :, :K]  # of the LSTM the first K outputs answer
        optimizer.zero_grad()
        cross_entropy(scores.flatten(0, 1), answer.flatten()).backward()
        optimizer.step()
        hits[n] = (scores.argmax(-1) == answer).float().mean()
    print(name, sum(p.numel() for p in model.parameters() if p.requires_grad), "parameters")
    left.plot(torch.arange(5, ITERATIONS - 4, 10), hits.unfold(0, 10, 10).mean(-1), label=name)
x = batch(1)[0]
trace = memory.trace(x).member(0)  # of the only sequence
cells = right.imshow(trace["weights"][P:], "Blues", extent=(0.5, S + 0.5, P, 0), aspect="auto")
figure.colorbar(cells, ax=right, label="read weight")
pair = (x[P:, 0, :K].argmax(-1)[:, None] == x[:P, 0, :K].argmax(-1)).int().argmax(-1)
begin = memory.cell.initial_state().mu.detach()[None]
moved = torch.tensor(trace["mu"]).diff(dim=0, prepend=begin).abs().sum(-1)
right.plot(moved[pair].argmax(-1) + 1, torch.arange(P) + 0.5, "x", color="tab:red")
left.set(xlabel="iteration", ylabel="accuracy", ylim=(0, 1.02))
left.legend(loc="center right")
right.set(xlabel="slot", ylabel="question", yticks=[], xticks=range(1, S + 1))
plt.show()
