// Start and halt, the controller with its gains, and the cut-off; each holds when the loop has said so.

import { announce } from "./announcer.js";
import { OPENING } from "./device.js";
import { byId, el, say } from "./dom.js";
import { significant, words } from "./format.js";
import { permit, whyNot } from "./permit.js";
import { AppliedForm, SettingsForm } from "./settings.js";
import { failed, followLink, showStatus, track } from "./status.js";
import { referenceUnit } from "./traces.js";

export function makeStart(store, commands) {
    const button = byId("start");
    const chip = byId("start-status");
    button.addEventListener("click", async () => {
        const { running, enabled, device, sample_time } = store.state;
        if (!running) {
            const again = { do: "open", device: { name: device.name, settings: device.settings }, sample_time };
            const opened = await track(chip, commands, again, OPENING);
            if (!opened.accepted) return;
        }
        const halts = running && enabled;
        const wrong = halts ? "" : await store.beforeStart();
        if (wrong) return showStatus(chip, "unstarted", wrong);
        const outcome = await track(chip, commands, { do: halts ? "halt" : "start" });
        if (!outcome.accepted) announce(failed(outcome));
    });
    store.on("state", (state) => {
        const turning = state.running && state.enabled && !state.unknown;
        say(button, turning ? "Halt" : "Start");
        button.classList.toggle("halts", turning);
        const reason = whyNot(state) || (state.fault ? "Acknowledge the fault first." : "");
        permit(button, reason);
        // What was asked for last is told until something keeps it from being asked for again.
        const closed = state.running || state.opening ? "" : closedSentence(state);
        const stopped = state.running && !state.enabled && state.stopped ? `${words(state.stopped)}.` : "";
        const told = reason || closed || stopped;
        if (told) showStatus(chip, "none", told);
        else if (chip.dataset.status === "none") showStatus(chip, "none");
    });
}

const closedSentence = ({ closed }) => `${closed ? `Closed: ${closed}. ` : "No device is open. "}Start opens it.`;

export function makeController(store, commands, controllers, scopes) {
    const chip = byId("controller-status");
    const settings = new SettingsForm({ prefix: "controller", label: "Kind of controller", members: controllers, onEdit: () => edited() });
    const applied = new AppliedForm({ form: byId("controller"), chip, settings, title: "Apply controller", send: () => send() });
    const edited = () => {
        applied.touch();
        showStatus(chip, "edited");
    };
    const question = el("div", { class: "question", role: "alert", hidden: true });
    byId("controller").append(question);
    const ask = () => {
        const choice = (title, run) => el("button", { type: "button", on: { click: () => ((question.hidden = true), run()) } }, title);
        const anew = async () => {
            const { device, sample_time } = store.state;
            const opened = await track(chip, commands, { do: "open", device: { name: device.name, settings: device.settings }, sample_time }, OPENING);
            if (opened.accepted) await send(true);
        };
        const { sentence } = farAway(store, scopes, settings.value());
        question.replaceChildren(
            el("p", {}, sentence),
            el("div", { class: "row" }, choice("Reopen the device", anew), choice("Apply anyway", () => send(true)), choice("Cancel", () => {})),
        );
        question.hidden = false;
    };
    const send = async (sure = false) => {
        let controller;
        try {
            controller = settings.value();
            applied.trouble.textContent = "";
        } catch (error) {
            applied.trouble.textContent = error.message;
            return;
        }
        if (!sure && farAway(store, scopes, controller)) return ask();
        const outcome = await track(chip, commands, { do: "set", controller });
        applied.sent(controller, outcome);
        announce(outcome.accepted ? `Controller applied: ${settings.member.title}` : `Controller: ${failed(outcome)}`);
    };
    applied.onRevert = () => showStatus(chip, "applied");
    store.on("proposed", ({ controller }) => {
        if (!controller) return;
        settings.show(controller);
        edited();
        if (store.state?.operator && !store.state.enabled) send();
    });
    store.on("state", (state) => {
        permit(applied.set, whyNot(state));
        if (state.controller && applied.follow(state.controller)) showStatus(chip, "applied");
        followLink(chip, state);
    });
}

// A controller that is about to follow a position that is more than a turn away: {sentence}; null otherwise.
function farAway(store, scopes, controller) {
    if (referenceUnit(controller) !== "rad" || referenceUnit(store.state?.controller) === "rad") return null;
    const { position, reference } = scopes.newest();
    const [at, wanted] = [position.at(-1), reference.at(-1)];
    const away = wanted - at;
    if (!(Math.abs(away) > 2 * Math.PI)) return null;
    const turns = significant(Math.abs(away) / (2 * Math.PI), 3);
    return {
        sentence:
            `The shaft is at ${significant(at, 4)} rad, and the signal's numbers, now radians, ask for ${significant(wanted, 3)}: the motor would turn back ` +
            `over ${turns} turns, as fast as it can. A reopened device counts from where it stands.`,
    };
}

const LOWPASS = /lowpass\s+([0-9.]+)\s*(rad\/s|Hz)?/;

// The cut-off in a chain [rad/s], or null where it has no low-pass filter.
export function cutoffOf(chain) {
    const found = LOWPASS.exec(chain ?? "");
    if (!found) return null;
    return Number(found[1]) * (found[2] === "Hz" ? 2 * Math.PI : 1);
}

// The same chain with that cut-off.
export function withCutoff(chain, cutoff) {
    const stage = `lowpass ${cutoff} rad/s`;
    if (LOWPASS.test(chain ?? "")) return chain.replace(LOWPASS, stage);
    return chain ? `${chain} | ${stage}` : `derivative | ${stage}`;
}

const BETWEEN = 80; // ms between two cut-offs that are sent while the slider moves

export function makeCutoff(store, commands) {
    const slider = byId("cutoff");
    const chip = byId("cutoff-status");
    let [waiting, busy] = [false, false];

    const tell = () => {
        const cutoff = Number(slider.value);
        const text = `${cutoff} rad/s`;
        say(byId("cutoff-value"), `${text}  ·  ${significant(cutoff / (2 * Math.PI), 3)} Hz`);
        slider.setAttribute("aria-valuetext", `${cutoff} radians per second`);
        slider.style.setProperty("--share", `${(100 * (cutoff - 10)) / 190}%`);
    };
    // The newest place of the slider is sent, those between are left out.
    const send = async () => {
        if (busy) {
            waiting = true;
            return;
        }
        busy = true;
        const cutoff = Number(slider.value);
        await track(chip, commands, { do: "set", chain: withCutoff(store.state?.chain, cutoff) });
        setTimeout(() => {
            busy = false;
            if (waiting) {
                waiting = false;
                send();
            }
        }, BETWEEN);
    };
    slider.addEventListener("input", () => {
        tell();
        send();
    });
    store.on("proposed", ({ chain }) => {
        const cutoff = cutoffOf(chain);
        if (cutoff === null || !store.state?.operator) return;
        slider.value = cutoff;
        tell();
        send();
    });
    let held = null;
    store.on("state", (state) => {
        permit(slider, whyNot(state));
        followLink(chip, state);
        if (state.chain === held || busy || waiting) return;
        held = state.chain;
        const cutoff = cutoffOf(state.chain);
        if (cutoff === null) return showStatus(chip, "none");
        slider.value = cutoff;
        showStatus(chip, "applied");
        tell();
    });
    tell();
}
