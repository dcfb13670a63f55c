"""Attention: weights over slots; mirrors `memory/hard.py`."""

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
