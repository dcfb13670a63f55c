"""Key rules: what a slot is compared with; mirrors `memory/keys.py`."""

from types import SimpleNamespace

import warp as wp


def make_representation(t: SimpleNamespace) -> SimpleNamespace:
    """The contents are the keys: mu_i / c_w against sigma, or mu_i' sigma."""
    real, State, pair = t.real, t.State, t.pair
    hidden_vector, slot_vector, key_matrix = t.hidden_vector, t.slot_vector, t.key_matrix
    S, N = t.S, t.N

    @wp.func
    def distances(y: State, hidden: hidden_vector, write_gain: real):
        """|sigma - mu_i / c_w|_inf: compared only, so that no gradient passes."""
        found = slot_vector()
        for i in range(S):
            largest = real(0.0)
            for j in range(N):
                largest = wp.max(largest, wp.abs(hidden[j] - y.mu[i, j] / write_gain))
            found[i] = largest
        return found

    @wp.func_grad(distances)
    def adj_distances(y: State, hidden: hidden_vector, write_gain: real, adj_ret: slot_vector):
        pass

    @wp.func
    def farthest(y: State, hidden: hidden_vector, slot: int, write_gain: real):
        worst = int(0)
        largest = real(-1.0)
        for j in range(N):
            apart = wp.abs(hidden[j] - y.mu[slot, j] / write_gain)
            if apart > largest:
                largest = apart
                worst = j
        return worst

    @wp.func_grad(farthest)
    def adj_farthest(
        y: State, hidden: hidden_vector, slot: int, write_gain: real, adj_ret: wp.int32
    ):
        pass

    @wp.func
    def distance(y: State, hidden: hidden_vector, slot: int, write_gain: real):
        """The same of one slot, with its gradient."""
        j = farthest(y, hidden, slot, write_gain)
        return wp.abs(hidden[j] - y.mu[slot, j] / write_gain)

    @wp.func
    def derivative(weights: slot_vector, y: State, key_rate: real):
        return key_matrix()

    @wp.func
    def fresh(q: pair):
        return pair()

    return SimpleNamespace(
        distances=distances,
        distance=distance,
        derivative=derivative,
        fresh=fresh,
    )


def make_state(t: SimpleNamespace) -> SimpleNamespace:
    """Keys are joint positions of their own: dk_i/dt = -c_k w_r(i) (k_i - x)."""
    real, State, pair = t.real, t.State, t.pair
    hidden_vector, slot_vector, key_matrix = t.hidden_vector, t.slot_vector, t.key_matrix
    S = t.S

    @wp.func
    def distances(y: State, hidden: hidden_vector, write_gain: real):
        found = slot_vector()
        for i in range(S):
            found[i] = wp.max(wp.abs(y.seen[0] - y.keys[i, 0]), wp.abs(y.seen[1] - y.keys[i, 1]))
        return found

    @wp.func_grad(distances)
    def adj_distances(y: State, hidden: hidden_vector, write_gain: real, adj_ret: slot_vector):
        pass

    @wp.func
    def distance(y: State, hidden: hidden_vector, slot: int, write_gain: real):
        """The same of one slot, with its gradient."""
        first = wp.abs(y.seen[0] - y.keys[slot, 0])
        second = wp.abs(y.seen[1] - y.keys[slot, 1])
        return wp.max(first, second)

    @wp.func
    def derivative(weights: slot_vector, y: State, key_rate: real):
        rate = key_matrix()
        for i in range(S):
            rate[i] = key_rate * weights[i] * (y.seen - y.keys[i])
        return rate

    @wp.func
    def fresh(q: pair):
        return q

    return SimpleNamespace(
        distances=distances,
        distance=distance,
        derivative=derivative,
        fresh=fresh,
    )
