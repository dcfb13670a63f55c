"""The two-link arm; mirrors `plants/plant.py` and `plants/two_link_arm.py`."""

from types import SimpleNamespace

import warp as wp

from ..form import Form


def make_arm(form: Form, t: SimpleNamespace, fn: SimpleNamespace) -> SimpleNamespace:
    """Accelerations under a force, and the stiff block. Coefficients k as in `ArmCoefficients`."""
    real, pair, square, coefficients = t.real, t.pair, t.square, t.coefficients
    COULOMB = form.coulomb
    solve, Angles = fn.solve, t.Angles

    @wp.func
    def angles(q: pair):
        """cos q_1, cos q_2, sin q_2, cos(q_1 + q_2): once a state, for all that follows."""
        return Angles(wp.cos(q[0]), wp.cos(q[1]), wp.sin(q[1]), wp.cos(q[0] + q[1]))

    @wp.func
    def mass_matrix(a: Angles, k: coefficients):
        coupling = k[2] * a[1]
        off = k[1] + coupling
        return square(k[0] + off + coupling, off, off, k[1])

    @wp.func
    def force(a: Angles, qd: pair, torque: pair, k: coefficients):
        h = k[2] * a[2]
        coriolis = pair(-h * qd[1] * qd[0] - h * (qd[0] + qd[1]) * qd[1], h * qd[0] * qd[0])
        outer_link = k[4] * a[3]
        inner_link = k[3] * a[0]
        load = pair(inner_link + outer_link + k[5] * qd[0], outer_link + k[6] * qd[1])
        if COULOMB:
            load = load + pair(k[7] * wp.tanh(qd[0] / k[9]), k[8] * wp.tanh(qd[1] / k[9]))
        return torque - coriolis - load

    @wp.func
    def load_slope(qd: pair, k: coefficients):
        slope = pair(k[5], k[6])
        if COULOMB:
            bend_0 = wp.tanh(qd[0] / k[9])
            bend_1 = wp.tanh(qd[1] / k[9])
            slope = slope + pair(
                k[7] * (real(1.0) - bend_0 * bend_0) / k[9],
                k[8] * (real(1.0) - bend_1 * bend_1) / k[9],
            )
        return slope

    @wp.func
    def acceleration(a: Angles, qd: pair, torque: pair, k: coefficients):
        return solve(mass_matrix(a, k), force(a, qd, torque, k))

    return SimpleNamespace(
        angles=angles, mass_matrix=mass_matrix, load_slope=load_slope, acceleration=acceleration
    )
