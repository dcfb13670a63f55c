"""Attention: weights over slots; mirrors `memory/soft.py` and `memory/hard.py`."""

from types import SimpleNamespace

import warp as wp


def make_nearest(t: SimpleNamespace) -> SimpleNamespace:
    """The active slot of least distance; the lowest index wins a tie."""
    real, slot_vector = t.real, t.slot_vector
    S = t.S

    @wp.func
    def nearest(distances: slot_vector, active: slot_vector):
        best = int(-1)
        least = real(0.0)
        for i in range(S):
            if active[i] > real(0.5) and (best < 0 or distances[i] < least):
                least = distances[i]
                best = i
        return best

    @wp.func_grad(nearest)
    def adj_nearest(distances: slot_vector, active: slot_vector, adj_ret: wp.int32):
        pass

    return SimpleNamespace(nearest=nearest)


def make_hard(t: SimpleNamespace, keys: SimpleNamespace) -> SimpleNamespace:
    """Weight 1 on the nearest slot."""
    real, State, constants = t.real, t.State, t.constants
    hidden_vector, slot_vector = t.hidden_vector, t.slot_vector
    nearest, distances = make_nearest(t).nearest, keys.distances

    @wp.func
    def attend(y: State, hidden: hidden_vector, active: slot_vector, c: constants):
        weights = slot_vector()
        weights[nearest(distances(y, hidden, c[6]), active)] = real(1.0)
        return weights

    @wp.func_grad(attend)
    def adj_attend(
        y: State,
        hidden: hidden_vector,
        active: slot_vector,
        c: constants,
        adj_ret: slot_vector,
    ):
        pass

    return SimpleNamespace(attend=attend)


def make_soft(t: SimpleNamespace, keys: SimpleNamespace) -> SimpleNamespace:
    """Softmax of the keys' inner products with the query, over the active slots."""
    real, State, constants = t.real, t.State, t.constants
    hidden_vector, slot_vector, S = t.hidden_vector, t.slot_vector, t.S
    scores = keys.scores

    @wp.func
    def masked_softmax(score: slot_vector, active: slot_vector):
        largest = real(-wp.inf)
        for i in range(S):
            if active[i] > real(0.5):
                largest = wp.max(largest, score[i])
        weights = slot_vector()
        total = real(0.0)
        for i in range(S):
            if active[i] > real(0.5):
                weights[i] = wp.exp(score[i] - largest)
                total += weights[i]
        return weights / total

    @wp.func_grad(masked_softmax)
    def adj_masked_softmax(score: slot_vector, active: slot_vector, adj_ret: slot_vector):
        weights = masked_softmax(score, active)
        mean = wp.dot(weights, adj_ret)
        for i in range(S):
            wp.adjoint[score][i] += weights[i] * (adj_ret[i] - mean)

    @wp.func
    def attend(y: State, hidden: hidden_vector, active: slot_vector, c: constants):
        return masked_softmax(scores(y, hidden), active)

    return SimpleNamespace(attend=attend)
