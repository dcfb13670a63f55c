"""The working memory: write law and jump; mirrors `memory/working_memory.py`."""

from types import SimpleNamespace

import warp as wp

from ..form import Form
from .attention import make_hard, make_nearest
from .keys import make_representation, make_state


def make_memory(form: Form, t: SimpleNamespace) -> SimpleNamespace:
    """Attention, write law and jump of one form."""
    real, State = t.real, t.State
    hidden_vector, slot_vector, contents = t.hidden_vector, t.slot_vector, t.contents
    S, ALWAYS = t.S, form.always
    representation = make_representation(t)
    keys = make_state(t) if form.keys == "state" else representation
    attend = make_hard(t, keys).attend
    relevance = representation.distances
    key_rate_of, fresh = keys.derivative, keys.fresh

    @wp.func
    def write(
        y: State, weights: slot_vector, hidden: hidden_vector, correction: hidden_vector, c_w: real
    ):
        """d mu_i / dt = w_i (c_w sigma + W r - mu_i)."""
        target = c_w * hidden + correction
        rate = contents()
        for i in range(S):
            rate[i] = weights[i] * (target - y.mu[i])
        return rate

    @wp.func
    def shift(distances: slot_vector, active: slot_vector, threshold: real):
        """The slot to reset, -1 for none: the first unused, else (always) the least relevant."""
        unused = int(-1)
        farthest = int(0)
        near = int(0)
        for i in range(S):
            if active[i] > real(0.5):
                if distances[i] < threshold:
                    near = int(1)
            elif unused < 0:
                unused = i
            if distances[i] > distances[farthest]:
                farthest = i
        slot = unused
        if ALWAYS and unused < 0:
            slot = farthest
        if near == 1:
            slot = int(-1)
        return slot

    @wp.func_grad(shift)
    def adj_shift(distances: slot_vector, active: slot_vector, threshold: real, adj_ret: wp.int32):
        pass

    @wp.func
    def largest(weights: slot_vector, active: slot_vector):
        best = int(-1)
        for i in range(S):
            if active[i] > real(0.0) and (best < 0 or weights[i] > weights[best]):
                best = i
        return best

    @wp.func_grad(largest)
    def adj_largest(weights: slot_vector, active: slot_vector, adj_ret: wp.int32):
        pass

    return SimpleNamespace(
        attend=attend,
        relevance=relevance,
        key_rate_of=key_rate_of,
        fresh=fresh,
        write=write,
        shift=shift,
        largest=largest,
        nearest=make_nearest(t).nearest,
        distances=keys.distances,
        distance=keys.distance,
        relevance_of=representation.distance,
    )
