"""Relaxed attention and its degree of resetting; mirrors `memory/relaxed.py`."""

from types import SimpleNamespace

import warp as wp

from ..form import Form
from .closeness import make_closeness, make_distances


def make_relaxed(form: Form, t: SimpleNamespace) -> SimpleNamespace:
    """Weights, degrees of resetting, and what depends on activity levels."""
    real, State, constants = t.real, t.State, t.constants
    hidden_vector, slot_vector, contents = t.hidden_vector, t.slot_vector, t.contents
    content_row, S, ALWAYS = t.content_row, t.S, form.always
    space, near = make_distances(form, t), make_closeness(t)
    relevance, distances = space.relevance, space.distances
    closeness, softmax, log_sum = near.closeness, near.softmax, near.log_sum

    @wp.func
    def attend(y: State, hidden: hidden_vector, active: slot_vector, c: constants):
        return softmax(closeness(distances(y, hidden, c), active, c[9]))

    @wp.func
    def falling(x: real):
        """1 / (1 + e^x)."""
        return real(1.0) / (real(1.0) + wp.exp(x))

    # Written out: e^x may overflow, and 0 times inf is NaN.
    @wp.func_grad(falling)
    def adj_falling(x: real, adj_ret: real):
        p = real(1.0) / (real(1.0) + wp.exp(x))
        wp.adjoint[x] -= p * (real(1.0) - p) * adj_ret

    @wp.func
    def target(distances: slot_vector, active: slot_vector):
        """The slot that may be reset, -1 for none: the first unused, else the least relevant."""
        unused = int(-1)
        farthest = int(0)
        for i in range(S):
            if active[i] < real(0.5) and unused < 0:
                unused = i
            if distances[i] > distances[farthest]:
                farthest = i
        if ALWAYS and unused < 0:
            unused = farthest
        return unused

    @wp.func_grad(target)
    def adj_target(distances: slot_vector, active: slot_vector, adj_ret: wp.int32):
        pass

    @wp.func
    def placed(slot: int, degree: real):
        mask = slot_vector()
        for i in range(S):
            if i == slot:
                mask[i] = degree
        return mask

    @wp.func_grad(placed)
    def adj_placed(slot: int, degree: real, adj_ret: slot_vector):
        for i in range(S):
            if i == slot:
                wp.adjoint[degree] += adj_ret[i]

    @wp.func
    def reset_degrees(y: State, hidden: hidden_vector, active: slot_vector, c: constants):
        """p on the slot that is reset now, 0 elsewhere."""
        R = relevance(y, hidden, c)
        p = falling(log_sum(closeness(R, active, c[9])) + c[7] / c[9])
        return placed(target(R, active), p)

    @wp.func
    def raised(active: slot_vector, mask: slot_vector):
        """Activity levels after the reset."""
        return wp.cw_mul(slot_vector(real(1.0)) - mask, active) + mask

    @wp.func
    def contents_square(mu: contents, active: slot_vector):
        total = (active[0] * active[0]) * wp.cw_mul(mu[0], mu[0])
        for i in range(1, S):
            total += (active[i] * active[i]) * wp.cw_mul(mu[i], mu[i])
        return wp.dot(total, content_row(real(1.0)))

    @wp.func_grad(contents_square)
    def adj_contents_square(mu: contents, active: slot_vector, adj_ret: real):
        for i in range(S):
            slope = real(2.0) * adj_ret * active[i]
            wp.adjoint[mu][i] += (slope * active[i]) * mu[i]
            wp.adjoint[active][i] += slope * wp.dot(mu[i], mu[i])

    return SimpleNamespace(
        attend=attend,
        reset_degrees=reset_degrees,
        raised=raised,
        contents_square=contents_square,
    )
