// What part of time the scopes show: running, paused, or held at a trigger; and where the cursors stand in it.

import { excerpt } from "./frames.js";
import { lastSweep } from "./trigger.js";

export const SPANS = [0.05, 0.1, 0.2, 0.5, 1, 2, 5, 10]; // s
export const HISTORY = 20; // s that the ring keeps; a whole sweep of 10 s fits in whatever the trigger's place

export class View {
    constructor(ring) {
        this.ring = ring;
        this.span = 10;
        this.frozen = null; // the data while paused
        this.range = null; // [from, to] while paused
        this.trigger = { on: false, single: false, trace: "applied", level: 2, rising: true, pre: 0.1 };
        this.swept = null; // {time, data} of the last trigger
        this.armed = true;
        this.cursors = null; // two shares of the screen's width
    }

    get paused() {
        return this.frozen !== null;
    }

    pause() {
        if (this.paused) return;
        const shown = this.shown();
        const data = this.swept && this.trigger.on ? this.swept.data : this.ring.view();
        this.frozen = excerpt(data, -Infinity, Infinity);
        this.range = [shown.from, shown.to];
    }

    resume() {
        this.frozen = this.range = null;
        this.armed = true;
    }

    // Show that part of what is paused; the cursors stay at their times.
    zoom(range) {
        this.pause();
        const whole = this.whole();
        const wanted = range ?? whole;
        const least = 5e-3;
        const width = Math.min(Math.max(wanted[1] - wanted[0], least), whole[1] - whole[0]);
        const from = Math.min(Math.max(wanted[0], whole[0]), whole[1] - width);
        const times = this.cursorTimes();
        this.range = [from, from + width];
        if (times) this.cursors = times.map((time) => Math.min(1, Math.max(0, (time - from) / width)));
    }

    whole() {
        const t = this.frozen.t;
        return t.length > 1 ? [t[0], t[t.length - 1]] : this.range;
    }

    scale(factor) {
        const { from, to } = this.shown();
        const middle = (from + to) / 2;
        const half = ((to - from) / 2) * factor;
        this.zoom([middle - half, middle + half]);
    }

    move(share) {
        const { from, to } = this.shown();
        const by = share * (to - from);
        this.zoom([from + by, to + by]);
    }

    // Look for a newer trigger; true where there is one.
    sweep() {
        if (!this.trigger.on || this.paused || !this.armed) return false;
        const data = this.ring.view();
        const { trace } = this.trigger;
        const time = lastSweep(data, trace, { ...this.trigger, span: this.span, hysteresis: this.hysteresis(data[trace]) });
        if (!(time > (this.swept?.time ?? -Infinity))) return false;
        const from = time - this.trigger.pre * this.span;
        this.swept = { time, from, span: this.span, data: excerpt(data, from, from + this.span) };
        if (this.trigger.single) this.armed = false;
        return true;
    }

    // A fiftieth of how far the trace goes, so that its noise triggers nothing.
    hysteresis(y) {
        let [low, high] = [Infinity, -Infinity];
        for (let k = 0; k < y.length; k++) {
            if (y[k] < low) low = y[k];
            if (y[k] > high) high = y[k];
        }
        return high > low ? (high - low) / 50 : 0;
    }

    // {data, from, to, origin, trigger}: what is to be drawn now.
    shown() {
        const held = this.trigger.on ? this.swept : null;
        const origin = held ? held.time : 0;
        const trigger = held ? { ...this.trigger, time: held.time } : null;
        if (this.paused) return { data: this.frozen, from: this.range[0], to: this.range[1], origin, trigger };
        if (held) return { data: held.data, from: held.from, to: held.from + held.span, origin, trigger };
        const to = Number.isFinite(this.ring.last) ? this.ring.last : this.span;
        return { data: this.ring.view(), from: to - this.span, to, origin, trigger };
    }

    cursorTimes() {
        if (!this.cursors) return null;
        const { from, to } = this.shown();
        return this.cursors.map((share) => from + share * (to - from));
    }
}
