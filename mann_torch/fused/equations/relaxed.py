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
    log_use, closeness = near.log_use, near.closeness
    softmax, log_sum = near.softmax, near.log_sum

    @wp.func
    def attend(y: State, hidden: hidden_vector, active: slot_vector, c: constants):
        return softmax(closeness(distances(y, hidden, c), log_use(active, c[9]), c[9]))

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
    def spread(use: slot_vector, farthest: slot_vector):
        """Shares u_i: P_(i-1) - P_i with P_i = g_1 ... g_i, and what is left to the farthest."""
        shares = slot_vector()
        before = real(1.0)
        for i in range(S):
            after = before * wp.exp(use[i])
            shares[i] = before - after
            before = after
        return shares + before * farthest

    @wp.func_grad(spread)
    def adj_spread(use: slot_vector, farthest: slot_vector, adj_ret: slot_vector):
        product = real(1.0)
        for i in range(S):
            product = product * wp.exp(use[i])
        wp.adjoint[farthest] += product * adj_ret
        # From the last product to the first: each log g_i enters those from P_i on.
        passed = product * wp.dot(farthest, adj_ret)
        for k in range(S):
            i = S - 1 - k
            product = real(1.0)
            for j in range(i + 1):
                product = product * wp.exp(use[j])
            passed -= product * adj_ret[i]
            if k > 0:
                passed += product * adj_ret[i + 1]
            wp.adjoint[use][i] += passed

    @wp.func
    def reset_degrees(y: State, hidden: hidden_vector, active: slot_vector, c: constants):
        """p u_i: how far each slot is reset now."""
        R = relevance(y, hidden, c)
        use = log_use(active, c[9])
        p = falling(log_sum(closeness(R, use, c[9])) + c[7] / c[9])
        farthest = slot_vector()
        if ALWAYS:
            farthest = softmax(closeness(-R, use, c[9]))
        return p * spread(use, farthest)

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
