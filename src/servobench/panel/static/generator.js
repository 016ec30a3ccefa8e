// The signal generator: any signal of the library, drawn before it's applied.

import { announce } from "./announcer.js";
import { byId } from "./dom.js";
import { permit, whyNot } from "./permit.js";
import { Preview } from "./preview.js";
import { AppliedForm, SettingsForm } from "./settings.js";
import { failed, followLink, showStatus, track } from "./status.js";
import { referenceUnit } from "./traces.js";

const WAIT = 150; // ms after the last change, before a preview is asked for

export function makeGenerator(store, commands, signals) {
    const chip = byId("signal-status");
    const preview = new Preview();
    const settings = new SettingsForm({ prefix: "signal", label: "Kind of signal", members: signals, onEdit: () => edited() });
    settings.body.before(preview.element);
    const applied = new AppliedForm({ form: byId("signal"), chip, settings, title: "Apply signal", send: () => send() });

    const read = () => {
        try {
            const value = settings.value();
            applied.trouble.textContent = "";
            return value;
        } catch (error) {
            applied.trouble.textContent = error.message;
            return null;
        }
    };
    const draw = async () => {
        const value = read();
        if (!value) return preview.clear();
        const wrong = await preview.show(value, spanOf(value));
        if (wrong) applied.trouble.textContent = wrong;
    };
    let timer = 0;
    const edited = () => {
        applied.touch();
        showStatus(chip, "edited");
        preview.age();
        clearTimeout(timer);
        timer = setTimeout(draw, WAIT);
    };
    // What keeps it from being in force; "" where it is.
    const send = async () => {
        const signal = read();
        if (!signal) return `The signal has a mistake: ${applied.trouble.textContent}`;
        const outcome = await track(chip, commands, { do: "set", signal });
        applied.sent(signal, outcome);
        announce(outcome.accepted ? `Signal applied: ${settings.member.title}` : `Signal: ${failed(outcome)}`);
        return outcome.accepted ? "" : `Signal: ${failed(outcome)}`;
    };
    // What is started is what is drawn.
    store.beforeStart = async () => (applied.edited ? send() : "");
    applied.onRevert = () => {
        showStatus(chip, "applied");
        draw();
    };
    store.on("proposed", ({ signal }) => {
        if (!signal) return;
        settings.show(signal);
        edited();
        // Of what turns, nothing changes before somebody has looked at it.
        if (store.state?.operator && !store.state.enabled) send();
    });
    let unit = "V";
    let sampleTime = null; // what is drawn is what is put out, at the loop's own times
    const follow = (now) => {
        if (now === unit) return;
        unit = now;
        settings.measure((own) => own.replace(/^V(?!\w)/, now));
        draw();
    };
    store.on("state", (state) => {
        follow(referenceUnit(state.controller));
        permit(applied.set, whyNot(state));
        const followed = state.signal && applied.follow(state.signal);
        if (followed) showStatus(chip, "applied");
        followLink(chip, state);
        if (followed || state.sample_time !== sampleTime) draw();
        sampleTime = state.sample_time;
    });
    draw();
}

// Over what time [s] a signal is drawn: two periods, all segments and a little of what comes after them, or ten seconds.
export function spanOf(signal) {
    const parts = Array.isArray(signal.parts) ? signal.parts.map(spanOf) : [];
    const lengths = Array.isArray(signal.segments) ? signal.segments.map(({ duration }) => Number(duration)) : [];
    let span = 10;
    if (parts.length) span = Math.max(...parts);
    else if (lengths.length) span = (signal.start ?? 0) + 1.04 * lengths.reduce((sum, length) => sum + length, 0);
    else if (signal.frequency > 0) span = (signal.start ?? 0) + 2 / signal.frequency;
    return span > 0 && Number.isFinite(span) ? span : 10;
}
