"""Event functions at a state; mirrors `simulation/branches.py`."""

from types import SimpleNamespace

import warp as wp

from ..form import TIE, Form
from .sinusoid import make_reference


def make_proximity(
    form: Form, t: SimpleNamespace, loop: SimpleNamespace, flow: wp.Function
) -> SimpleNamespace:
    """Event functions, without gradient and, one of them, with it."""
    real, pair, square, State, Sample = t.real, t.pair, t.square, t.State, t.Sample
    constants, coefficients, event_values = t.constants, t.coefficients, t.event_values
    hidden_vector, slot_vector, S = t.hidden_vector, t.slot_vector, t.S
    REALLOCATES, ALWAYS, NOISE = form.reallocates, form.always, form.noise
    look, sigmoid, memory = loop.look, loop.sigmoid, loop.memory
    nearest, distances, relevance = memory.nearest, memory.distances, memory.relevance
    distance, relevance_of = memory.distance, memory.relevance_of
    sample, INF = make_reference(t).sample, wp.constant(real(wp.inf))
    TIE_ = wp.constant(real(TIE))

    @wp.struct
    class Scene:
        """What a step needs beside its state."""

        time: real
        s_0: Sample
        s_1: Sample
        amplitude: pair
        frequency: pair
        offset: pair
        error_gain: square
        c: constants
        k: coefficients

    @wp.func
    def within(scene: Scene, tau: real):
        """The reference inside the step, with its noise."""
        s = sample(scene.time + tau, scene.amplitude, scene.frequency, scene.offset)
        if NOISE:
            s.noise_q = scene.s_0.noise_q
            s.noise_qd = scene.s_0.noise_qd
        return s

    @wp.func
    def branch(slot: int):
        weights = slot_vector()
        weights[slot] = real(1.0)
        return weights

    @wp.func_grad(branch)
    def adj_branch(slot: int, adj_ret: slot_vector):
        pass

    @wp.func
    def hop(
        y: State,
        active: slot_vector,
        weights: slot_vector,
        s_0: Sample,
        s_1: Sample,
        h: real,
        scene: Scene,
    ):
        """The flow from a state at which nothing was seen yet."""
        gaze = look(s_0, y, scene.error_gain)
        hidden = sigmoid(gaze.pre)
        return flow(
            y,
            gaze,
            hidden,
            active,
            weights,
            s_0,
            s_1,
            h,
            scene.error_gain,
            scene.c,
            scene.k,
        )

    @wp.func
    def compare(y: State, hidden: hidden_vector, active: slot_vector, attended: int, c: constants):
        """D_s - D_j of every slot, then min R - theta; -inf where there is no such event."""
        found = event_values()
        apart = distances(y, hidden, c[6])
        full = int(1)
        for i in range(S):
            found[i] = -INF
            if active[i] < real(0.5):
                full = int(0)
            elif i != attended:
                found[i] = apart[attended] - apart[i]
        found[S] = -INF
        if REALLOCATES and (ALWAYS or full == 0):
            relevant = relevance(y, hidden, c[6])
            found[S] = relevant[nearest(relevant, active)] - c[7]
        return found

    @wp.func_grad(compare)
    def adj_compare(
        y: State,
        hidden: hidden_vector,
        active: slot_vector,
        attended: int,
        c: constants,
        adj_ret: event_values,
    ):
        pass

    @wp.func
    def events_at(y: State, s: Sample, active: slot_vector, attended: int, scene: Scene):
        return compare(y, sigmoid(look(s, y, scene.error_gain).pre), active, attended, scene.c)

    @wp.func_grad(events_at)
    def adj_events_at(
        y: State,
        s: Sample,
        active: slot_vector,
        attended: int,
        scene: Scene,
        adj_ret: event_values,
    ):
        pass

    @wp.func
    def value(y: State, s: Sample, active: slot_vector, attended: int, number: int, scene: Scene):
        """One event function, with its gradient."""
        hidden = sigmoid(look(s, y, scene.error_gain).pre)
        found = real(0.0)
        if number < S:
            here = distance(y, hidden, attended, scene.c[6])
            found = here - distance(y, hidden, number, scene.c[6])
        if REALLOCATES and number == S:
            near = nearest(relevance(y, hidden, scene.c[6]), active)
            found = relevance_of(y, hidden, near, scene.c[6]) - scene.c[7]
        return found

    @wp.func
    def attend(y: State, hidden: hidden_vector, active: slot_vector, attended: int, c: constants):
        """The nearest slot; one within TIE of it goes on."""
        apart = distances(y, hidden, c[6])
        slot = nearest(apart, active)
        if attended >= 0 and apart[attended] - apart[slot] <= TIE_:
            slot = attended
        return slot

    @wp.func_grad(attend)
    def adj_attend(
        y: State,
        hidden: hidden_vector,
        active: slot_vector,
        attended: int,
        c: constants,
        adj_ret: wp.int32,
    ):
        pass

    return SimpleNamespace(
        Scene=Scene,
        attend=attend,
        branch=branch,
        compare=compare,
        events_at=events_at,
        hop=hop,
        value=value,
        within=within,
    )
