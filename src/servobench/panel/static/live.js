// The live model: each parameter with its interval, drawn as a whisker that shrinks as the data come in.

import { byId, el, say, shape } from "./dom.js";
import { significant, words } from "./format.js";
import { permit, whyNot } from "./permit.js";
import { complain } from "./announcer.js";

const WIDEST = 0.3; // of the value: half the width of a whisker that fills its line
const NARROWEST = 0.001;

export function makeLive(store, commands) {
    const rows = new Map();
    const list = el("ul", { class: "parameters" });
    const empty = el("p", { class: "quiet", role: "status" });
    let heard = -Infinity; // when it last said how far it is [ms]
    let ended = "";
    const tellEmpty = () => say(empty, ended || whyEmpty(store.state, performance.now() - heard));
    setInterval(tellEmpty, 500);
    tellEmpty();
    const samples = el("p", { class: "quiet number" });
    const { element: wish, light } = makeWish(store, commands);
    byId("live").append(empty, list, samples, wish);

    const rowOf = (name) => {
        if (!rows.has(name)) {
            const value = el("output", { class: "value", "aria-live": "off" });
            const unit = el("span", { class: "unit" });
            const share = el("span", { class: "share number" });
            const bar = el("span", { class: "bar" });
            const interval = el("span", { class: "interval number" });
            const element = el(
                "li",
                {},
                el("span", { class: "name" }, words(name)),
                el("span", { class: "figure" }, value, unit),
                el("span", { class: "whisker", "aria-hidden": "true" }, bar),
                el("span", { class: "row between" }, interval, share),
            );
            list.append(element);
            rows.set(name, { element, value, unit, share, bar, interval });
        }
        return rows.get(name);
    };
    store.on("live", (live) => {
        const names = Object.keys(live.parameters);
        empty.hidden = names.length > 0;
        heard = performance.now();
        ended = live.ended ?? "";
        tellEmpty();
        for (const [name, row] of rows) row.element.hidden = !names.includes(name);
        for (const name of names) showRow(rowOf(name), live.parameters[name]);
        say(samples, names.length ? `from ${live.samples.toLocaleString("en")} samples` : "");
        light(live.enough);
    });
}

const SILENT = 1500; // ms; it says something five times a second once it is ready

// Why nothing is known of the motor yet.
function whyEmpty(state, silent) {
    if (!state?.running || state.unknown) return "Gain and time constant appear here while the motor turns.";
    if (!state.followed) return "This device doesn't say what it measures, so it can't be identified while it runs: record, and identify the recording.";
    if (silent > SILENT && state.enabled) return "Preparing live identification. The first time this may take a minute, as its equations are compiled; recordings aren't affected.";
    return state.enabled ? "The motor turns; there isn't enough data yet." : "Start the motor: gain and time constant appear here while it turns.";
}

// Half an interval: in percent of its value, or in the value's unit where that is less than the half itself.
export function halfWidth(value, interval, unit) {
    const [low, high] = interval ?? [NaN, NaN];
    const half = (high - low) / 2;
    if (!Number.isFinite(half)) return "";
    return half < Math.abs(value) ? `±${significant((100 * half) / Math.abs(value), 2)} %` : `±${significant(half, 2)} ${unit}`;
}

function showRow(row, { value, interval, unit }) {
    const [low, high] = interval ?? [NaN, NaN];
    const share = (high - low) / 2 / Math.abs(value);
    // As many digits as the interval leaves, and one more.
    const digits = Number.isFinite(share) && share > 0 ? Math.min(6, Math.max(2, 2 - Math.floor(Math.log10(share)))) : 3;
    say(row.value, significant(value, digits));
    say(row.unit, unit);
    say(row.share, halfWidth(value, interval, unit));
    say(row.interval, Number.isFinite(low) ? `${significant(low, digits)} to ${significant(high, digits)}` : "no interval yet");
    const width = Math.log(Math.min(WIDEST, Math.max(NARROWEST, share || WIDEST)) / NARROWEST) / Math.log(WIDEST / NARROWEST);
    row.bar.style.setProperty("--width", `${Math.round(100 * Math.max(0.03, width))}%`);
}

// "Enough": when one parameter's interval is as narrow as was wished.
function makeWish(store, commands) {
    const NAMES = ["time_constant", "gain", "coulomb_voltage"];
    const name = el("select", { id: "wish-name" }, NAMES.map((each) => el("option", { value: each }, words(each))));
    const share = el("input", { id: "wish-share", type: "number", min: 0.01, max: 50, step: "any", value: 1 });
    const button = el("button", { type: "submit", class: "plain" }, "Set");
    const state = el("p", { class: "enough", "data-level": "off" }, shape(), el("span", { role: "status" }, "No wish set"));
    const form = el(
        "form",
        { class: "wish", novalidate: true },
        el("h3", {}, "Enough when"),
        el(
            "div",
            { class: "row" },
            el("label", { for: "wish-name", class: "hide" }, "Parameter"),
            name,
            el("label", { for: "wish-share", class: "hide" }, "Interval in percent"),
            el("span", { class: "entry" }, share, el("span", { class: "unit" }, "± %")),
            button,
        ),
        state,
    );
    let wished = false;
    form.addEventListener("submit", async (event) => {
        event.preventDefault();
        const outcome = await commands.ask({ do: "wish", until: `${name.value}=${Number(share.value)}%` });
        wished ||= outcome.accepted;
        if (!outcome.accepted) complain(outcome.why);
    });
    const light = (enough) => {
        state.dataset.level = enough ? "ok" : wished ? "warn" : "off";
        say(state.lastElementChild, enough ? "Enough: the interval is reached" : wished ? "Not yet" : "No wish set");
    };
    store.on("state", (state) => permit(button, whyNot(state)));
    return { element: form, light };
}
