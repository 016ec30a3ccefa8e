// The strips that come with the trigger and with the cursors: their settings, and what is read there.

import { differences } from "./cursors.js";
import { byId, el, say } from "./dom.js";
import { fixed, seconds, significant } from "./format.js";

const TRIGGERS = { applied: "Applied", commanded: "Commanded", reference: "Reference", speed: "Speed", position: "Position", current: "Current" };

const labelled = (text, field) => el("label", { class: "inline" }, el("span", {}, text), field);

export function makeTriggerStrip(scopes) {
    const { trigger } = scopes.view;
    const strip = byId("trigger-strip");
    const change = (set) => scopes.act(() => {
        set();
        scopes.view.swept = null;
        scopes.view.armed = true;
    });
    const trace = el(
        "select",
        { on: { change: () => change(() => (trigger.trace = trace.value)) } },
        Object.entries(TRIGGERS).map(([name, title]) => el("option", { value: name, selected: name === trigger.trace }, title)),
    );
    const level = el("input", { type: "number", step: "any", value: trigger.level });
    level.addEventListener("change", () => change(() => (trigger.level = Number(level.value))));
    const edge = el(
        "select",
        { on: { change: () => change(() => (trigger.rising = edge.value === "rising")) } },
        el("option", { value: "rising" }, "Rising"),
        el("option", { value: "falling" }, "Falling"),
    );
    const pre = el("input", { type: "range", min: 0, max: 90, step: 5, value: 100 * trigger.pre, on: { input: () => change(() => tellPre()) } });
    const preText = el("output", { class: "number" });
    const tellPre = () => {
        trigger.pre = Number(pre.value) / 100;
        preText.textContent = `${pre.value} %`;
        pre.setAttribute("aria-valuetext", `${pre.value} percent of the screen before the trigger`);
    };
    tellPre();
    const single = el("input", { type: "checkbox", on: { change: () => change(() => (trigger.single = single.checked)) } });
    const again = el("button", { type: "button", class: "tool wide", on: { click: () => change(() => {}) } }, "Arm again");
    const status = el("span", { class: "quiet", role: "status" });
    strip.append(labelled("On", trace), labelled("Level", level), labelled("Edge", edge));
    strip.append(el("span", { class: "inline" }, labelled("Before", pre), preText), labelled("Single", single), again, status);
    return () => {
        strip.hidden = !trigger.on;
        again.hidden = !trigger.single;
        const { swept, armed } = scopes.view;
        say(status, !armed ? "Triggered, held" : swept ? "Triggered" : "Waiting for the level");
    };
}

// What a filter leaves of nothing long after is nothing to a reader.
const readable = (value) => (Math.abs(value) < 1e-9 ? 0 : value);

export function makeCursorStrip(scopes) {
    const strip = byId("cursor-strip");
    const sliders = ["A", "B"].map((name, k) =>
        el("input", {
            type: "range",
            min: 0,
            max: 1000,
            step: 1,
            "aria-label": `Cursor ${name}`,
            on: { input: ({ target }) => scopes.act(() => (scopes.view.cursors[k] = Number(target.value) / 1000)) },
        }),
    );
    const times = ["A", "B"].map(() => el("output", { class: "number", "aria-live": "off" }));
    const span = el("output", { class: "number strong", "aria-live": "off" });
    const places = ["A", "B"].map((name, k) => el("span", { class: "inline" }, el("span", {}, name), sliders[k], times[k]));
    const body = el("tbody");
    const head = ["Trace", "A", "B", "B − A", "per second"].map((text) => el("th", { scope: "col" }, text));
    strip.append(el("div", { class: "row" }, places, span), el("table", {}, el("thead", {}, el("tr", {}, head)), body));
    let rows = [];
    let keys = "";

    const build = (traces) => {
        rows = traces.map(({ scope, trace }) => {
            const cells = ["a", "b", "difference", "slope"].map(() => el("td", {}));
            body.append(el("tr", {}, el("th", { scope: "row" }, `${scope.definition.title}, ${trace.title.toLowerCase()} [${trace.unit}]`), cells));
            return cells;
        });
    };
    return () => {
        const under = scopes.underCursors();
        strip.hidden = !under;
        if (!under) return;
        const { times: at, origin, data, traces } = under;
        const now = traces.map(({ scope, trace }) => `${scope.definition.id}.${trace.column}.${trace.unit}`).join();
        if (now !== keys) {
            body.replaceChildren();
            build(traces);
            keys = now;
        }
        const found = differences(data.t, traces.map(({ trace }) => data[trace.column]), at[0], at[1]);
        sliders.forEach((slider, k) => {
            const text = `${fixed(at[k] - origin, 4)} s`;
            if (document.activeElement !== slider) slider.value = Math.round(1000 * scopes.view.cursors[k]);
            slider.setAttribute("aria-valuetext", text);
            say(times[k], text);
        });
        say(span, `Δt ${seconds(found.span)}  ·  1/Δt ${Number.isFinite(found.rate) ? `${significant(found.rate, 4)} Hz` : "–"}`);
        found.rows.forEach((row, k) => {
            const { factor } = traces[k].trace;
            [row.a, row.b, row.difference, row.slope].forEach((value, c) => say(rows[k][c], significant(readable(factor * value), 5)));
        });
    };
}
