"""Whether a state is in range; mirrors the check in `simulation/stepping.py`."""

from types import SimpleNamespace

import warp as wp

from ..form import Form
from .types import N_JOINTS


def make_guard(form: Form, t: SimpleNamespace, fn: SimpleNamespace) -> SimpleNamespace:
    """`trouble(y, limit)`: 0, or 10 * (number of the first bad leaf + 1) + 1 or 2.

    1 stands for an entry of `limit` or more, 2 for one that is no finite number.
    """
    real, State = t.real, t.State
    N, S, M, I = t.N, t.S, t.M, t.I  # noqa: E741
    n, slot_vector = N_JOINTS, t.slot_vector
    outer_square, inner_square = fn.outer_square, fn.inner_square
    contents_square = fn.contents_square
    MEMORY, STATE_KEYS = form.n_slots > 0, form.keys == "state"

    @wp.func
    def worse(found: int, leaf: int, x: real, limit: real):
        """The first leaf counts; in it, what is not finite."""
        code = int(0)
        if not wp.isfinite(x):
            code = leaf + 2
        elif wp.abs(x) >= limit:
            code = leaf + 1
        if found == 0 or (code > found and code < found + 2):
            return code
        return found

    @wp.func
    def search(y: State, limit: real):
        found = int(0)
        for i in range(n):
            found = worse(found, 10, y.q[i], limit)
        for i in range(n):
            found = worse(found, 20, y.qd[i], limit)
        for i in range(N):
            for j in range(n):
                found = worse(found, 30, y.W[i, j], limit)
        for i in range(n):
            found = worse(found, 40, y.b_w[i], limit)
        for i in range(I):
            for j in range(N):
                found = worse(found, 50, y.V[i, j], limit)
        for i in range(N):
            found = worse(found, 60, y.b_v[i], limit)
        if MEMORY:
            for i in range(S):
                for j in range(M):
                    found = worse(found, 70, y.mu[i, j], limit)
        if STATE_KEYS:
            for i in range(S):
                for j in range(n):
                    found = worse(found, 80, y.keys[i, j], limit)
        return found

    @wp.func
    def trouble(y: State, limit: real):
        total = wp.dot(y.q, y.q) + wp.dot(y.qd, y.qd) + wp.dot(y.b_w, y.b_w)
        total = total + wp.dot(y.b_v, y.b_v) + outer_square(y.W) + inner_square(y.V)
        if MEMORY:
            total = total + contents_square(y.mu, slot_vector(real(1.0)))
        if STATE_KEYS:
            total = total + wp.ddot(y.keys, y.keys)
        found = int(0)
        # NaN compares as False: it is searched for too.
        if not (total < limit * limit):
            found = search(y, limit)
        return found

    @wp.func_grad(trouble)
    def adj_trouble(y: State, limit: real, adj_ret: wp.int32):
        pass

    # Backwards, a step that is computed at all was in range.
    @wp.func_replay(trouble)
    def replay_trouble(y: State, limit: real):
        return int(0)

    return SimpleNamespace(trouble=trouble)
