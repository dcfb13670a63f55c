"""How close slots are, with gradients; mirrors `closeness` in `memory/relaxed.py`.

Distances have a gradient here: through the largest component.
"""

from types import SimpleNamespace

import warp as wp

from ..form import Form


def make_distances(form: Form, t: SimpleNamespace) -> SimpleNamespace:
    """Distances of contents (`relevance`) and of what is compared (`distances`) to the query."""
    real, State, pair, constants = t.real, t.State, t.pair, t.constants
    hidden_vector, slot_vector, content_row = t.hidden_vector, t.slot_vector, t.content_row
    contents, key_matrix, S, N = t.contents, t.key_matrix, t.S, t.N
    STATE_KEYS = form.keys == "state"

    @wp.func
    def from_contents(mu: contents, hidden: hidden_vector, write_gain: real):
        """|sigma - mu_i / c_w|_inf."""
        found = slot_vector()
        for i in range(S):
            largest = real(0.0)
            for j in range(N):
                largest = wp.max(largest, wp.abs(hidden[j] - mu[i, j] / write_gain))
            found[i] = largest
        return found

    @wp.func_grad(from_contents)
    def adj_from_contents(
        mu: contents, hidden: hidden_vector, write_gain: real, adj_ret: slot_vector
    ):
        for i in range(S):
            worst = int(0)
            largest = real(0.0)
            for j in range(N):
                size = wp.abs(hidden[j] - mu[i, j] / write_gain)
                if size > largest:
                    largest = size
                    worst = j
            if largest > real(0.0):
                slope = wp.sign(hidden[worst] - mu[i, worst] / write_gain) * adj_ret[i]
                query = hidden_vector()
                query[worst] = slope
                row = content_row()
                row[worst] = slope / write_gain
                wp.adjoint[hidden] += query
                wp.adjoint[mu][i] -= row
                wp.adjoint[write_gain] += row[worst] * mu[i, worst] / write_gain

    @wp.func
    def from_keys(keys: key_matrix, q: pair):
        """|x - k_i|_inf."""
        found = slot_vector()
        for i in range(S):
            found[i] = wp.max(wp.abs(q[0] - keys[i, 0]), wp.abs(q[1] - keys[i, 1]))
        return found

    @wp.func_grad(from_keys)
    def adj_from_keys(keys: key_matrix, q: pair, adj_ret: slot_vector):
        for i in range(S):
            away = q - keys[i]
            row = pair()
            if wp.abs(away[0]) >= wp.abs(away[1]):
                row[0] = wp.sign(away[0]) * adj_ret[i]
            else:
                row[1] = wp.sign(away[1]) * adj_ret[i]
            if wp.dot(away, away) > real(0.0):
                wp.adjoint[q] += row
                wp.adjoint[keys][i] -= row

    @wp.func
    def relevance(y: State, hidden: hidden_vector, c: constants):
        return from_contents(y.mu, hidden, c[6])

    @wp.func
    def key_distances(y: State, hidden: hidden_vector, c: constants):
        return from_keys(y.keys, y.q)

    distances = key_distances if STATE_KEYS else relevance
    return SimpleNamespace(relevance=relevance, distances=distances)


def make_closeness(t: SimpleNamespace) -> SimpleNamespace:
    """log g_i - D_i / T, g_i the degree to which a slot of activity a_i is in use."""
    real, slot_vector, S = t.real, t.slot_vector, t.S
    TINY = wp.constant(real(2.2250738585072014e-308))

    @wp.func
    def log_odds(level: real):
        return wp.log(level) - wp.log(real(1.0) - level)

    @wp.func
    def log_use(active: slot_vector, temperature: real):
        use = slot_vector()
        for i in range(S):
            if active[i] < TINY:
                use[i] = real(-wp.inf)
            elif active[i] < real(1.0):
                x = log_odds(active[i]) / temperature
                use[i] = wp.min(x, real(0.0)) - wp.log(real(1.0) + wp.exp(-wp.abs(x)))
        return use

    @wp.func_grad(log_use)
    def adj_log_use(active: slot_vector, temperature: real, adj_ret: slot_vector):
        for i in range(S):
            if active[i] >= TINY and active[i] < real(1.0):
                odds = log_odds(active[i])
                slope = adj_ret[i] / temperature / (real(1.0) + wp.exp(odds / temperature))
                bend = real(1.0) / active[i] + real(1.0) / (real(1.0) - active[i])
                wp.adjoint[active][i] += slope * bend
                wp.adjoint[temperature] -= slope * odds / temperature

    @wp.func
    def tied(distances: slot_vector, use: slot_vector, slot: int):
        """1 where an earlier slot is exactly as far, and no less in use."""
        found = int(0)
        for i in range(S):
            if i < slot and distances[i] == distances[slot] and use[i] >= use[slot]:
                found = int(1)
        return found

    @wp.func
    def closeness(distances: slot_vector, use: slot_vector, temperature: real):
        score = slot_vector()
        for i in range(S):
            score[i] = real(-wp.inf)
            if tied(distances, use, i) == 0:
                score[i] = use[i] - distances[i] / temperature
        return score

    @wp.func_grad(closeness)
    def adj_closeness(
        distances: slot_vector, use: slot_vector, temperature: real, adj_ret: slot_vector
    ):
        for i in range(S):
            if tied(distances, use, i) == 0:
                slope = adj_ret[i] / temperature
                wp.adjoint[use][i] += adj_ret[i]
                wp.adjoint[distances][i] -= slope
                wp.adjoint[temperature] += slope * distances[i] / temperature

    @wp.func
    def softmax(score: slot_vector):
        largest = real(-wp.inf)
        for i in range(S):
            largest = wp.max(largest, score[i])
        weights = slot_vector()
        total = real(0.0)
        for i in range(S):
            weights[i] = wp.exp(score[i] - largest)
            total += weights[i]
        return weights / total

    @wp.func_grad(softmax)
    def adj_softmax(score: slot_vector, adj_ret: slot_vector):
        weights = softmax(score)
        mean = wp.dot(weights, adj_ret)
        for i in range(S):
            wp.adjoint[score][i] += weights[i] * (adj_ret[i] - mean)

    @wp.func
    def log_sum(score: slot_vector):
        largest = real(-wp.inf)
        for i in range(S):
            largest = wp.max(largest, score[i])
        total = real(0.0)
        for i in range(S):
            total += wp.exp(score[i] - largest)
        return largest + wp.log(total)

    @wp.func_grad(log_sum)
    def adj_log_sum(score: slot_vector, adj_ret: real):
        wp.adjoint[score] += adj_ret * softmax(score)

    return SimpleNamespace(log_use=log_use, closeness=closeness, softmax=softmax, log_sum=log_sum)
