"""A step that stops at its first event; mirrors `simulation/events.py`.

A step's event is a row: kind (0 none, 1 switch, 2 reset, 3 chattering), number of the event
function, branch attended after it (chattering: the other one), root [s], slope [1/s], and the slot
that is reset (kind 0: 1 where an event is left pending). The forward pass decides it and keeps it
on the tape; the backward pass reads it there and differentiates what it says.
"""

from types import SimpleNamespace

import warp as wp

from ..form import FLAT, GRAZE, TIE, Form
from .proximity import make_proximity


def make_hybrid(form: Form, t: SimpleNamespace, stepping: SimpleNamespace) -> SimpleNamespace:
    """The hybrid step; `stepping` is what `make_step` gave."""
    real, State, Mode, event_row = t.real, t.State, t.Mode, t.event_row
    slot_vector, hidden_vector, event_values = t.slot_vector, t.hidden_vector, t.event_values
    S, INF = t.S, wp.constant(real(wp.inf))
    STATE_KEYS, REALLOCATES = form.keys == "state", form.reallocates
    pair, EFFORT = t.pair, form.effort
    loop, flow, count_jump = stepping.loop, stepping.flow, stepping.count
    look, sigmoid, reset_mask = loop.look, loop.sigmoid, loop.reset_mask
    reset, reset_keys = loop.reset, loop.reset_keys
    loop_gain, torque_of = loop.gain_of, loop.torque_of
    shift, relevance = loop.memory.shift, loop.memory.relevance
    near = make_proximity(form, t, loop, flow)
    Scene, branch, hop, within = near.Scene, near.branch, near.hop, near.within
    compare, events_at, value, attend = near.compare, near.events_at, near.value, near.attend
    first_root, slope_at, top, which = near.first_root, near.slope_at, near.top, near.which
    TIE_, GRAZE_, FLAT_ = (wp.constant(real(x)) for x in (TIE, GRAZE, FLAT))

    @wp.struct
    class HybridOutcome:
        y: State
        mode: Mode
        event: event_row
        torque: pair

    @wp.func
    def mark(e: event_row):
        """1 on the slot that the event resets."""
        mask = slot_vector()
        if int(e[0]) == 2:
            mask[int(e[5])] = real(1.0)
        return mask

    @wp.func_grad(mark)
    def adj_mark(e: event_row, adj_ret: slot_vector):
        pass

    @wp.func
    def is_pending(values: event_values, partner: int):
        found = int(0)
        for i in range(S + 1):
            if i != partner and values[i] > TIE_:
                found = int(1)
        return found

    @wp.func_grad(is_pending)
    def adj_is_pending(values: event_values, partner: int, adj_ret: wp.int32):
        pass

    @wp.func
    def decide(
        y: State,
        hidden: hidden_vector,
        end: State,
        active: slot_vector,
        attended: int,
        h: real,
        scene: Scene,
        known: event_row,
    ):
        e = event_row()
        after = events_at(end, scene.s_1, active, attended, scene)
        passed = int(0)
        for i in range(S + 1):
            if after[i] > real(0.0):
                passed = int(1)
        if passed == 0:
            return e
        before = compare(y, hidden, active, attended, scene.c)
        crossed = event_values()
        number = int(0)
        for i in range(S + 1):
            if before[i] <= TIE_ and after[i] > real(0.0) and after[i] < INF:
                crossed[i] = real(1.0)
                number = number + 1
        e[5] = real(is_pending(after, -1))
        if number == 0:
            return e
        if crossed[S] < real(0.5):
            partner = which(after, crossed)
            other = hop(y, active, branch(partner), scene.s_0, scene.s_1, h, scene)
            back = events_at(other, scene.s_1, active, attended, scene)
            if back[partner] < before[partner]:
                e[0] = real(3.0)
                e[1] = real(partner)
                e[2] = real(partner)
                return e
        root = first_root(y, active, attended, h, crossed, before, after, scene)
        s_r = within(scene, root)
        at = hop(y, active, branch(attended), scene.s_0, s_r, root, scene)
        event = which(events_at(at, s_r, active, attended, scene), crossed)
        slope = slope_at(y, active, attended, root, h, event, scene)
        if slope * h <= GRAZE_ * (top(after, crossed) - top(before, crossed)) + FLAT_:
            return e
        e[0] = real(1.0)
        e[1] = real(event)
        e[2] = real(event)
        e[3] = root
        e[4] = slope
        if REALLOCATES and event == S:
            seen = sigmoid(look(s_r, at, scene.error_gain).pre)
            slot = shift(relevance(at, seen, scene.c[6]), active, real(-1.0))
            e[0] = real(2.0)
            e[5] = real(slot)
            mask = mark(e)
            at.mu = reset(at, seen, mask, scene.c[6])
            if STATE_KEYS:
                at.keys = reset_keys(at, mask)
            e[2] = real(attend(at, seen, wp.max(active, mask), attended, scene.c))
        return e

    @wp.func_grad(decide)
    def adj_decide(
        y: State,
        hidden: hidden_vector,
        end: State,
        active: slot_vector,
        attended: int,
        h: real,
        scene: Scene,
        known: event_row,
        adj_ret: event_row,
    ):
        pass

    @wp.func_replay(decide)
    def replay_decide(
        y: State,
        hidden: hidden_vector,
        end: State,
        active: slot_vector,
        attended: int,
        h: real,
        scene: Scene,
        known: event_row,
    ):
        return known

    @wp.func
    def located(y: State, active: slot_vector, attended: int, e: event_row, h: real, scene: Scene):
        """flow(event(flow(y, e_s, tau)), e_j, h - tau), with one Newton correction of tau."""
        held = branch(attended)
        s_r = within(scene, e[3])
        there = hop(y, active, held, scene.s_0, s_r, e[3], scene)
        tau = e[3] - value(there, s_r, active, attended, int(e[1]), scene) / e[4]
        s_t = within(scene, tau)
        at = hop(y, active, held, scene.s_0, s_t, tau, scene)
        gaze = look(s_t, at, scene.error_gain)
        hidden = sigmoid(gaze.pre)
        mask = mark(e)
        after = at
        if REALLOCATES:
            after.mu = reset(at, hidden, mask, scene.c[6])
            if STATE_KEYS:
                after.keys = reset_keys(at, mask)
        return flow(
            after,
            gaze,
            hidden,
            wp.max(active, mask),
            branch(int(e[2])),
            s_t,
            scene.s_1,
            h - tau,
            scene.error_gain,
            scene.c,
            scene.k,
        )

    @wp.func_replay(located)
    def replay_located(
        y: State, active: slot_vector, attended: int, e: event_row, h: real, scene: Scene
    ):
        return State()

    @wp.func
    def slide(y: State, active: slot_vector, attended: int, e: event_row, h: real, scene: Scene):
        """flow(y, alpha e_s + (1 - alpha) e_j, h) that ends where both slots are as near."""
        partner = int(e[2])
        mine = branch(attended)
        others = branch(partner)
        end = hop(y, active, mine, scene.s_0, scene.s_1, h, scene)
        other = hop(y, active, others, scene.s_0, scene.s_1, h, scene)
        forth = value(end, scene.s_1, active, attended, partner, scene)
        back = value(other, scene.s_1, active, attended, partner, scene)
        share = -back / (forth - back)
        weights = share * mine + (real(1.0) - share) * others
        gaze = look(scene.s_0, y, scene.error_gain)
        hidden = sigmoid(gaze.pre)
        return flow(
            y,
            gaze,
            hidden,
            active,
            weights,
            scene.s_0,
            scene.s_1,
            h,
            scene.error_gain,
            scene.c,
            scene.k,
        )

    @wp.func_replay(slide)
    def replay_slide(
        y: State, active: slot_vector, attended: int, e: event_row, h: real, scene: Scene
    ):
        return State()

    @wp.func
    def count(
        mode: Mode, mask: slot_vector, attended: int, e: event_row, result: State, scene: Scene
    ):
        """Mode after the step: slots in use, attended slot and counters."""
        kind = int(e[0])
        new = Mode()
        happened = mark(e)
        new.active = wp.max(wp.max(mode.active, mask), happened)
        counts = count_jump(mode, attended, mask)
        pending = int(e[5])
        if kind == 1 or kind == 2:
            counts[3] = counts[3] + 1
            if int(e[2]) != attended:
                counts[1] = counts[1] + 1
            if kind == 2:
                counts[2] = counts[2] + 1
            counts[0] = int(e[2])
        if kind == 3:
            counts[4] = counts[4] + 1
        if kind > 0:
            partner = int(-1)
            if kind == 3:
                partner = int(e[2])
            left = events_at(result, scene.s_1, new.active, counts[0], scene)
            pending = is_pending(left, partner)
        counts[5] = counts[5] + pending
        new.counts = counts
        return new

    @wp.func_grad(count)
    def adj_count(
        mode: Mode,
        mask: slot_vector,
        attended: int,
        e: event_row,
        result: State,
        scene: Scene,
        adj_ret: Mode,
    ):
        pass

    @wp.func_replay(count)
    def replay_count(
        mode: Mode, mask: slot_vector, attended: int, e: event_row, result: State, scene: Scene
    ):
        return Mode()

    @wp.func
    def step(before: State, mode: Mode, h: real, scene: Scene, known: event_row):
        out = HybridOutcome()
        gaze = look(scene.s_0, before, scene.error_gain)
        hidden = sigmoid(gaze.pre)
        y = before
        active = mode.active
        mask = slot_vector()
        if REALLOCATES:
            mask = reset_mask(before, hidden, active, scene.c)
            y.mu = reset(before, hidden, mask, scene.c[6])
            if STATE_KEYS:
                y.keys = reset_keys(before, mask)
            active = wp.max(active, mask)
        attended = attend(y, hidden, active, mode.counts[0], scene.c)
        end = flow(
            y,
            gaze,
            hidden,
            active,
            branch(attended),
            scene.s_0,
            scene.s_1,
            h,
            scene.error_gain,
            scene.c,
            scene.k,
        )
        e = decide(y, hidden, end, active, attended, h, scene, known)
        if EFFORT:
            gain = loop_gain(y, active, scene.c)
            out.torque = torque_of(y, gaze, hidden, branch(attended), gain)
        kind = int(e[0])
        result = end
        if kind == 1 or kind == 2:
            result = located(y, active, attended, e, h, scene)
        if kind == 3:
            result = slide(y, active, attended, e, h, scene)
        out.y = result
        out.event = e
        out.mode = count(mode, mask, attended, e, result, scene)
        return out

    # As in the plain step: the adjoint computes it again itself.
    @wp.func_replay(step)
    def replay_step(before: State, mode: Mode, h: real, scene: Scene, known: event_row):
        return HybridOutcome()

    return SimpleNamespace(step=step, Scene=Scene)
