// The lights: each a shape, a word and its reason, so that nobody needs to see a colour. Also the fault, and what to do about it.

import { announce, complain, toast } from "./announcer.js";
import { byId, el, say, shape } from "./dom.js";
import { clock, significant } from "./format.js";
import { permit, whyNot } from "./permit.js";

const LIT_FOR = 5000; // ms
const NAMES = { link: "Link", stall: "Stall", limits: "Limits", lateness: "Lateness", whiteness: "Model" };

export function makeLights(store, commands) {
    const lights = {};
    const lateness = makeLateness();
    for (const [name, title] of Object.entries(NAMES)) {
        const reason = el("span", { class: "reason" });
        const element = el("li", { "data-light": name, "data-level": "off" }, shape(), el("strong", {}, title), reason);
        lights[name] = { element, reason };
        byId("lights").append(element);
    }
    const show = (name, level, text) => {
        lights[name].element.dataset.level = level;
        say(lights[name].reason, text);
    };
    for (const name of Object.keys(NAMES)) show(name, "off", "unknown");

    const unknown = (...names) => names.forEach((name) => show(name, "off", "unknown"));
    store.on("link", (status) => {
        const texts = { connected: "connected", silent: "no data", lost: "lost; trying again", unknown: "this page has expired" };
        show("link", status === "connected" ? "ok" : "bad", texts[status]);
        if (status !== "connected") unknown("whiteness");
        else announce("Connected");
    });
    store.on("state", (state) => {
        showRun(store, state);
        if (state.unknown || (!state.running && !state.fault)) return unknown("stall", "limits", "lateness");
        const stalled = state.fault?.code?.includes("stall");
        show("stall", stalled ? "bad" : "ok", stalled ? "the shaft stood still" : "none");
        // Those that hold the voltage back now, each with its sentence.
        const reached = state.limits ?? [];
        show("limits", reached.length ? "warn" : "ok", reached.length ? reached.map((limit) => limit.sentence).join(" ") : "within");
        show("lateness", lateness(state), state.late || state.missed ? `${state.late} late, ${state.missed} missed` : "none");
    });
    store.on("live", (live) => {
        const text = { true: "fits what is measured", false: "misses something: residuals aren't noise" }[live.white] ?? "not known yet";
        show("whiteness", live.white === true ? "ok" : live.white === false ? "warn" : "off", text);
    });
    makeFault(store, commands);
}

// What was late a while ago is counted, but lights nothing any more.
function makeLateness() {
    const since = { late: -Infinity, missed: -Infinity };
    let before = null;
    return (state) => {
        const now = performance.now();
        for (const kind of ["late", "missed"]) if (before && state[kind] > before[kind]) since[kind] = now;
        before = { late: state.late, missed: state.missed };
        if (now - since.missed < LIT_FOR) return "bad";
        return now - since.late < LIT_FOR ? "warn" : "ok";
    };
}

function showRun(store, state) {
    const run = byId("run");
    const [level, text] = state.unknown
        ? ["off", "Unknown"]
        : state.fault
        ? ["bad", "Fault"]
        : state.opening
          ? ["off", "Opening …"]
          : !state.running
            ? ["off", "Closed"]
            : state.enabled
              ? ["ok", "Driving"]
              : ["off", "Zero volts"];
    if (run.dataset.text !== text) announce({ Unknown: "What the motor does isn't known", Fault: `Fault: ${state.fault?.sentence}`, Driving: "The motor is driven" }[text] ?? text);
    run.dataset.text = text;
    run.dataset.level = level;
    say(byId("run-text"), text);
}

// Faults of the computer, not of the motor: there is nothing to be seen to at the motor before it turns again.
const BUSY = ["ticks-missed", "watchdog"];

function makeFault(store, commands) {
    const show = (fault) => {
        const place = byId("fault");
        if (fault) say(byId("fault-text"), fault.sentence ?? fault.code);
        byId("go-on").hidden = !BUSY.includes(fault?.code);
        place.hidden = !fault;
    };
    store.on("state", (state) => {
        show(state.fault);
        for (const name of ["acknowledge", "go-on"]) permit(byId(name), whyNot(state));
    });
    store.on("fault", show);
    const acknowledge = async (next) => {
        for (const wanted of [{ do: "acknowledge" }, ...next]) {
            const outcome = await commands.ask(wanted);
            if (!outcome.accepted) return say(byId("fault-text"), outcome.why);
        }
        byId("start").focus();
    };
    byId("acknowledge").addEventListener("click", () => acknowledge([]));
    byId("go-on").addEventListener("click", () => acknowledge([{ do: "start" }]));
}

export function makeRecord(store, commands) {
    const button = byId("record");
    const name = byId("record-name");
    button.addEventListener("click", async () => {
        const asked = store.state?.recording
            ? { do: "end_record" }
            : { do: "record", name: name.value || name.placeholder, duration: Number(byId("record-length").value) || null };
        const wrong = asked.do === "record" && nameTrouble(name.value);
        if (wrong) return complain(wrong.sentence, wrong.fitting && { title: `Take ${wrong.fitting}`, run: () => (name.value = wrong.fitting) });
        const outcome = await commands.ask(asked);
        if (!outcome.accepted) complain(`Not recorded: ${outcome.why}`);
        else announce(asked.do === "record" ? `Recording ${asked.name}` : "Recording ended");
    });
    store.on("state", (state) => {
        const { recording } = state;
        const on = Boolean(recording);
        button.classList.toggle("on", on);
        const reason = whyNot(state);
        permit(button, reason || (state.running ? "" : "No device is open."));
        for (const field of [name, byId("record-length")]) permit(field, reason || (on ? "A recording is being made." : ""));
        say(byId("record-text"), on ? "End" : "Record");
        say(byId("record-what"), on ? "recording" : "");
        say(byId("record-time"), on ? `${clock(recording.length)}${recording.duration ? ` / ${clock(recording.duration)}` : ""}` : "");
    });
    // An exercise says how long it is to be recorded.
    store.on("proposed", ({ duration }) => {
        if (!duration) return;
        const length = byId("record-length");
        if (![...length.options].some((option) => Number(option.value) === duration)) {
            length.append(el("option", { value: duration }, `${Number(duration.toPrecision(4))} s`));
        }
        length.value = String(duration);
    });
    store.on("library-names", (names) => {
        let number = 1;
        while (names.has(`run-${number}`)) number += 1;
        name.placeholder = `run-${number}`;
    });
    store.on("recorded", (message) => {
        name.value = "";
        const sentence = recordedSentence(message);
        toast(sentence);
        announce(sentence);
    });
}

// What keeps a text from being a recording's name: {sentence, fitting}, a name like it that would do; null where nothing does.
export function nameTrouble(text) {
    const bad = [...new Set(text.match(/[^A-Za-z0-9._-]/gu) ?? [])].map((each) => (/\s/.test(each) ? "a space" : `“${each}”`));
    const begins = /^[._-]/.test(text);
    if (!bad.length && !begins) return null;
    const what = bad.length ? `can't have ${bad.join(", ")} in it` : `can't begin with “${text[0]}”`;
    const plain = text.normalize("NFKD").replace(/\p{M}/gu, "");
    const fitting = plain.replace(/[^A-Za-z0-9._-]+/g, "-").replace(/^[._-]+|[.-]+$/g, "").slice(0, 64);
    return { sentence: `“${text}”: a recording's name ${what}; letters a to z, digits, and . _ - can.`, fitting };
}

// What became of a recording: its length, and why it is shorter than was asked for, where it is.
export function recordedSentence({ name, length, duration, early }) {
    const long = `Recorded ${name}: ${significant(length, 3)} s`;
    if (!early) return long;
    return `${long}${duration ? ` of ${significant(duration, 3)} s` : ""}, as ${early}`;
}
