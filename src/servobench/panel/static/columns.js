// What the columns of an imported file are: a small form, made from the file, with what is known already chosen.

import { get } from "./api.js";
import { el, say, slug } from "./dom.js";

const TIME_UNITS = { s: 1, ms: 1e-3, us: 1e-6, min: 60 };
const UNITS = {
    time: Object.keys(TIME_UNITS),
    input: ["V", "mV", "%"],
    output: ["rad", "deg", "rev", "counts", "rad/s", "deg/s", "rpm", "rev/s", "counts/s"],
};
const QUESTIONS = {
    time: "Which column is the time?",
    input: "Which column drives the motor?",
    output: "Which column was measured on the motor: its position, or its speed?",
};
const EVENLY = "/evenly"; // in the place of a column
const AS_THEY_ARE = "/own";

// The form of a recording; `send(answers)` returns whether they were kept, and `onDone` is called then.
export async function columnsForm(name, send, onDone) {
    const asked = await get(`/api/recordings/${encodeURIComponent(name)}/columns`);
    const id = `columns-${slug(name)}`;
    const time = timeQuestion(id, asked);
    const roles = Object.fromEntries(["input", "output"].map((role) => [role, question(id, role, asked)]));
    const chain = el("input", { id: `${id}-chain`, autocomplete: "off", spellcheck: "false", placeholder: "none", set: { value: asked.said.chain ?? asked.chain ?? "" } });
    const trouble = el("p", { class: "trouble", role: "alert" });
    const save = el("button", { class: "primary", type: "submit" }, "Use these columns");
    const form = el(
        "form",
        { class: "columns", novalidate: true, "aria-label": `Columns of ${name}` },
        el("p", { class: "quiet" }, "The columns of the file, with their first values:"),
        el("ul", { class: "firsts" }, asked.columns.map(firstValues)),
        time.element,
        roles.input.element,
        roles.output.element,
        el(
            "div",
            { class: "field" },
            el("label", { for: chain.id }, "Its processing before recording (optional)"),
            chain,
            el("p", { class: "quiet" }, "Such as derivative | lowpass 50 rad/s; none if there was none. If left empty, a filter's lag counts as the motor's."),
        ),
        trouble,
        el("div", { class: "row" }, save),
    );
    form.addEventListener("submit", async (event) => {
        event.preventDefault();
        const missing = [time, roles.input, roles.output].map((each) => each.missing()).find(Boolean);
        say(trouble, missing ?? "");
        if (missing) return;
        save.disabled = true;
        const answers = { ...time.answer(), ...roles.input.answer(), ...roles.output.answer(), chain: chain.value };
        try {
            await send(answers);
            onDone();
        } catch (error) {
            say(trouble, error.message);
        } finally {
            save.disabled = false;
        }
    });
    return form;
}

function firstValues({ name, unit, first }) {
    const values = first.map((value) => (value === null ? "–" : Number(value.toPrecision(6)))).join("  ");
    return el("li", {}, el("strong", {}, unit ? `${name} [${unit}]` : name), ` ${values} …`);
}

const option = (value, title) => el("option", { value }, title);

// A column and its unit; nothing is chosen that isn't known.
function question(id, role, asked, more = []) {
    const { column, unit } = saidOr(asked, role);
    const columns = el("select", { id: `${id}-${role}` }, option("", "choose …"), asked.columns.map(({ name }) => option(name, name)), more);
    const units = el("select", { id: `${id}-${role}-unit`, "aria-label": `Unit of the ${role}` }, option("", "unit …"), offered(role, asked).map((each) => option(each, each)));
    columns.value = column ?? "";
    units.value = unit ?? "";
    const own = () => asked.columns.find(({ name }) => name === columns.value)?.unit;
    columns.addEventListener("change", () => {
        units.value = offered(role, asked).includes(own()) ? own() : "";
    });
    const element = el("div", { class: "field" }, el("label", { for: columns.id }, QUESTIONS[role]), el("div", { class: "row" }, columns, units));
    const missing = () => {
        if (!columns.value) return `${QUESTIONS[role]} Choose one.`;
        return units.value ? null : `In which unit is ${columns.value}? Choose one.`;
    };
    return { element, columns, units, missing, answer: () => ({ [role]: `${columns.value}:${units.value}` }) };
}

function timeQuestion(id, asked) {
    const more = [option(EVENLY, "none: evenly spaced")];
    if (asked.own_times) more.push(option(AS_THEY_ARE, "as the file has them"));
    const asks = question(id, "time", asked, more);
    const step = el("input", { id: `${id}-step`, "aria-label": "Time between two samples", placeholder: "20 ms", autocomplete: "off", set: { value: asked.said.sample_time ? `${asked.said.sample_time} s` : "" } });
    const hint = el("p", { class: "quiet", "aria-live": "polite" });
    if (asked.said.sample_time) asks.columns.value = EVENLY;
    else if (asked.own_times && !asked.said.time) asks.columns.value = AS_THEY_ARE;
    asks.units.after(step);
    asks.element.append(hint);
    const show = () => {
        step.hidden = asks.columns.value !== EVENLY;
        asks.units.hidden = [EVENLY, AS_THEY_ARE].includes(asks.columns.value);
        say(hint, asks.units.hidden ? "" : spacing(asked, asks.columns.value, asks.units.value));
    };
    for (const each of [asks.columns, asks.units]) each.addEventListener("change", show);
    show();
    return {
        element: asks.element,
        missing: () => {
            if (asks.columns.value === EVENLY) return step.value.trim() ? null : "What is the time between two samples? Such as 20 ms.";
            return asks.columns.value === AS_THEY_ARE ? null : asks.missing();
        },
        answer: () => {
            if (asks.columns.value === EVENLY) return { sample_time: step.value };
            return asks.columns.value === AS_THEY_ARE ? {} : asks.answer();
        },
    };
}

// What a unit would mean, so that a wrong one is seen.
function spacing({ columns }, name, unit) {
    const column = columns.find((each) => each.name === name);
    if (!column || !unit || column.first.length < 2) return "";
    const step = (column.first[1] - column.first[0]) * TIME_UNITS[unit];
    return `Then the first two samples are ${Number((1000 * step).toPrecision(4))} ms apart; the file has ${column.samples} samples.`;
}

// The units to choose from, that of a column among them.
function offered(role, { columns, ...asked }) {
    return [...new Set([...UNITS[role], asked[role].unit].filter(Boolean))];
}

// What was answered before, or else what is known.
function saidOr(asked, role) {
    const said = asked.said[role];
    if (!said) return asked[role];
    const cut = said.lastIndexOf(":");
    return { column: said.slice(0, cut), unit: said.slice(cut + 1) };
}
