"""Maths shared by the equations; mirrors `mann_torch.functional`."""

from types import SimpleNamespace

import warp as wp


def make_functional(t: SimpleNamespace) -> SimpleNamespace:
    """Safe root, sums of squares, sigmoid, 2 x 2 solves."""
    real, pair, square, hidden_vector = t.real, t.pair, t.square, t.hidden_vector
    outer_weights, inner_weights, contents = t.outer_weights, t.inner_weights, t.contents
    N, S, I = t.N, t.S, t.I  # noqa: E741
    slot_vector, content_row = t.slot_vector, t.content_row

    @wp.func
    def root(square_sum: real):
        return wp.sqrt(square_sum)

    # Its gradient at 0 is 0, as of torch's norms.
    @wp.func_grad(root)
    def adj_root(square_sum: real, adj_ret: real):
        if square_sum > real(0.0):
            wp.adjoint[square_sum] += real(0.5) * adj_ret / wp.sqrt(square_sum)

    # Sums of squares go row by row, a vector at a time: `wp.ddot` is one long chain of additions.
    @wp.func
    def outer_square(W: outer_weights):
        total = wp.cw_mul(W[0], W[0])
        for i in range(1, N):
            total += wp.cw_mul(W[i], W[i])
        return total[0] + total[1]

    @wp.func_grad(outer_square)
    def adj_outer_square(W: outer_weights, adj_ret: real):
        wp.adjoint[W] += (real(2.0) * adj_ret) * W

    @wp.func
    def inner_square(V: inner_weights):
        total = wp.cw_mul(V[0], V[0])
        for i in range(1, I):
            total += wp.cw_mul(V[i], V[i])
        return wp.dot(total, hidden_vector(real(1.0)))

    @wp.func_grad(inner_square)
    def adj_inner_square(V: inner_weights, adj_ret: real):
        wp.adjoint[V] += (real(2.0) * adj_ret) * V

    @wp.func
    def contents_square(mu: contents, active: slot_vector):
        total = active[0] * wp.cw_mul(mu[0], mu[0])
        for i in range(1, S):
            total += active[i] * wp.cw_mul(mu[i], mu[i])
        return wp.dot(total, content_row(real(1.0)))

    @wp.func_grad(contents_square)
    def adj_contents_square(mu: contents, active: slot_vector, adj_ret: real):
        for i in range(S):
            wp.adjoint[mu][i] += (real(2.0) * adj_ret * active[i]) * mu[i]

    @wp.func
    def sigmoid(pre: hidden_vector):
        hidden = hidden_vector()
        for i in range(N):
            hidden[i] = real(1.0) / (real(1.0) + wp.exp(-pre[i]))
        return hidden

    # Written out: exp(-pre) may overflow, and 0 times inf is NaN.
    @wp.func_grad(sigmoid)
    def adj_sigmoid(pre: hidden_vector, adj_ret: hidden_vector):
        for i in range(N):
            s = real(1.0) / (real(1.0) + wp.exp(-pre[i]))
            wp.adjoint[pre][i] += s * (real(1.0) - s) * adj_ret[i]

    @wp.func
    def solve(A: square, b: pair):
        det = A[0, 0] * A[1, 1] - A[0, 1] * A[1, 0]
        return pair(
            (A[1, 1] * b[0] - A[0, 1] * b[1]) / det, (A[0, 0] * b[1] - A[1, 0] * b[0]) / det
        )

    return SimpleNamespace(
        root=root,
        outer_square=outer_square,
        inner_square=inner_square,
        contents_square=contents_square,
        sigmoid=sigmoid,
        solve=solve,
    )
