"""Event functions inside a step and their first root; mirrors `simulation/roots.py`."""

from types import SimpleNamespace

import warp as wp

from ..form import ITERATIONS, ROUNDING, STENCIL, TIE, WIDTH, Form
from .sinusoid import make_reference


def make_proximity(
    form: Form, t: SimpleNamespace, loop: SimpleNamespace, flow: wp.Function
) -> SimpleNamespace:
    """Event functions at a state, without gradient and, one of them, with it; the root search."""
    real, pair, square, State, Sample = t.real, t.pair, t.square, t.State, t.Sample
    constants, coefficients, event_values = t.constants, t.coefficients, t.event_values
    hidden_vector, slot_vector, S = t.hidden_vector, t.slot_vector, t.S
    REALLOCATES, ALWAYS, NOISE = form.reallocates, form.always, form.noise
    look, sigmoid, memory = loop.look, loop.sigmoid, loop.memory
    nearest, distances, relevance = memory.nearest, memory.distances, memory.relevance
    distance, relevance_of = memory.distance, memory.relevance_of
    sample, INF = make_reference(t).sample, wp.constant(real(wp.inf))
    TIE_, WIDTH_, STENCIL_ = (wp.constant(real(x)) for x in (TIE, WIDTH, STENCIL))
    ROUNDING_, ITERATIONS_ = wp.constant(real(ROUNDING)), wp.constant(ITERATIONS)

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

    @wp.func
    def probe(y: State, active: slot_vector, attended: int, tau: real, scene: Scene):
        s = within(scene, tau)
        at = hop(y, active, branch(attended), scene.s_0, s, tau, scene)
        return events_at(at, s, active, attended, scene)

    @wp.func
    def which(values: event_values, crossed: event_values):
        """The largest of the events that are crossed."""
        best = int(-1)
        for i in range(S + 1):
            if crossed[i] > real(0.5) and (best < 0 or values[i] > values[best]):
                best = i
        return best

    @wp.func
    def top(values: event_values, crossed: event_values):
        return values[which(values, crossed)]

    @wp.func
    def first_root(
        y: State,
        active: slot_vector,
        attended: int,
        h: real,
        crossed: event_values,
        before: event_values,
        after: event_values,
        scene: Scene,
    ):
        """Illinois' rule on the largest of the crossed events."""
        low = real(0.0)
        high = h
        f_low = top(before, crossed)
        f_high = top(after, crossed)
        limit = wp.max(WIDTH_ * (f_high - f_low), ROUNDING_)
        side = int(0)
        done = int(0)
        root = h
        if f_low >= real(0.0):
            done = int(1)
            root = low
        turn = int(0)
        while turn < ITERATIONS_ and done == 0:
            root = high - f_high * (high - low) / (f_high - f_low)
            f = top(probe(y, active, attended, root, scene), crossed)
            if f > real(0.0):
                if side > 0:
                    f_low = real(0.5) * f_low
                f_high = f
                high = root
                side = 1
            else:
                if side < 0:
                    f_high = real(0.5) * f_high
                f_low = f
                low = root
                side = -1
            if wp.abs(f) <= limit or high - low <= WIDTH_ * h:
                done = 1
            turn = turn + 1
        return root

    @wp.func_grad(first_root)
    def adj_first_root(
        y: State,
        active: slot_vector,
        attended: int,
        h: real,
        crossed: event_values,
        before: event_values,
        after: event_values,
        scene: Scene,
        adj_ret: real,
    ):
        pass

    @wp.func
    def slope_at(
        y: State,
        active: slot_vector,
        attended: int,
        root: real,
        h: real,
        number: int,
        scene: Scene,
    ):
        """Central difference of fourth order."""
        delta = STENCIL_ * h
        total = real(0.0)
        k = int(-2)
        while k <= 2:
            if k != 0:
                found = probe(y, active, attended, root + real(k) * delta, scene)[number]
                factor = real(1.0)
                if k == 1 or k == -1:
                    factor = real(-8.0)
                if k > 0:
                    factor = -factor
                total = total + factor * found
            k = k + 1
        return total / (real(12.0) * delta)

    @wp.func_grad(slope_at)
    def adj_slope_at(
        y: State,
        active: slot_vector,
        attended: int,
        root: real,
        h: real,
        number: int,
        scene: Scene,
        adj_ret: real,
    ):
        pass

    return SimpleNamespace(
        Scene=Scene,
        attend=attend,
        branch=branch,
        compare=compare,
        events_at=events_at,
        first_root=first_root,
        hop=hop,
        slope_at=slope_at,
        top=top,
        value=value,
        which=which,
        within=within,
    )
