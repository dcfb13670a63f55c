"""A step that stops at its first event; mirrors `simulation/events.py`."""

from types import SimpleNamespace

import warp as wp

from ..form import Form
from .decision import make_decision
from .proximity import make_proximity


def make_hybrid(form: Form, t: SimpleNamespace, stepping: SimpleNamespace) -> SimpleNamespace:
    """The hybrid step; `stepping` is what `make_step` gave."""
    real, State, Mode, event_row = t.real, t.State, t.Mode, t.event_row
    slot_vector = t.slot_vector
    STATE_KEYS, REALLOCATES = form.keys == "state", form.reallocates
    pair, EFFORT = t.pair, form.effort
    loop, flow, count_jump = stepping.loop, stepping.flow, stepping.count
    look, sigmoid, reset_mask = loop.look, loop.sigmoid, loop.reset_mask
    reset, reset_keys = loop.reset, loop.reset_keys
    loop_gain, torque_of = loop.gain_of, loop.torque_of
    near = make_proximity(form, t, loop, flow)
    Scene, branch, hop, within = near.Scene, near.branch, near.hop, near.within
    events_at, value, attend = near.events_at, near.value, near.attend
    decision = make_decision(form, t, loop, near)
    mark, is_pending, decide = decision.mark, decision.is_pending, decision.decide

    @wp.struct
    class HybridOutcome:
        y: State
        mode: Mode
        event: event_row
        torque: pair

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
