// The models of recordings that are compared, side by side: each figure with its interval, and how far it lies from the first one's.

import { announce } from "./announcer.js";
import { get } from "./api.js";
import { difference, isTold, listed, summary } from "./difference.js";
import { el, say, shape, slug } from "./dom.js";
import { fixed, plainly, significant, words } from "./format.js";
import { workProgress } from "./progress.js";

const FIRST = ["gain", "time_constant", "coulomb_voltage", "delay"];
const LEVELS = { trusted: "ok", doubtful: "warn", refused: "bad" };
const MILLI = 0.01; // s; shorter times are told in ms
const EVEN = 0.1; // of its half: an interval that lies more askew than that is told by its ends

// Where the models stand: `show(names)` fills it, `spoilt(names)` says which of them can't be read, `know(recordings)` and
// `work(message)` keep it true. `identify(name)` is asked for.
export function makeModels(identify) {
    const element = el("div", { class: "models", hidden: true });
    let names = [];
    let known = new Map(); // name -> what the list of recordings says
    const going = new Map(); // name -> how far its identification is
    const over = new Set(); // names of those that are over, but what came of them isn't known here yet
    let unread = [];
    let turn = 0;

    const draw = async () => {
        const mine = (turn += 1);
        const held = names.length > 1 ? [...names] : []; // one alone is told in the list of recordings
        const results = await Promise.all(held.map((name) => resultOf(known.get(name))));
        if (mine !== turn) return;
        const at = element.contains(document.activeElement) ? document.activeElement.id : null;
        element.hidden = !held.length;
        element.replaceChildren(...(held.length ? content(held.map((name, k) => ({ name, about: known.get(name), going: going.get(name), spoilt: unread.includes(name), ...results[k] })), start) : []));
        if (at) (document.getElementById(at) ?? element.querySelector(".scroll")).focus();
    };
    const start = async (name) => {
        if (going.has(name)) return;
        if (await identify(name)) announce(`${name} is identified`);
    };
    return {
        element,
        show: (chosen) => {
            names = [...chosen];
            return draw();
        },
        spoilt: (those) => {
            if (those.join() === unread.join()) return;
            unread = those;
            draw();
        },
        know: (recordings) => {
            known = new Map(recordings.map((each) => [each.name, each]));
            for (const name of over) going.delete(name);
            over.clear();
            if (names.length) draw();
        },
        work: (message) => {
            if (message.over) return over.add(message.name); // `know` follows
            const begun = going.has(message.name);
            over.delete(message.name);
            going.set(message.name, message);
            if (!names.includes(message.name)) return;
            const place = document.getElementById(`models-${slug(message.name)}-progress`);
            if (begun && place) say(place, workProgress(message).sentence);
            else draw();
        },
    };
}

// {result} of a recording that is identified, {trouble} where it can't be had, {} of any other.
async function resultOf(about) {
    if (!about?.verdict) return {};
    try {
        return { result: await get(`/api/recordings/${encodeURIComponent(about.name)}/result`) };
    } catch (error) {
        return { trouble: error.message };
    }
}

function content(columns, start) {
    const [first, ...others] = columns;
    const usable = ({ result }) => Boolean(result) && result.verdict !== "refused";
    const rows = quantities(columns.filter(usable).map(({ result }) => result.parameters)).map((key) => quantity(key, columns, usable));
    const table = el(
        "table",
        {},
        el("thead", {}, el("tr", {}, el("td", {}), columns.map(heading))),
        el("tbody", {}, verdicts(columns, start), rows.map((row) => row.element)),
    );
    const said = usable(first) ? others.filter(usable).map((other) => summary(other.name, first.name, rows.map((row) => row.differences.get(other.name)))) : [];
    return [
        el("h3", { id: "models-title" }, "Identified models"),
        said.length ? el("ul", { class: "told" }, said.map((each) => el("li", {}, each)), doubts(columns.filter(usable))) : null,
        el("div", { class: "scroll", role: "region", tabindex: "0", "aria-labelledby": "models-title" }, table),
        said.length ? el("p", { class: "quiet explained" }, `± is the 95 % interval. sd: the standard deviation of the difference to ${first.name}, √(sd₁² + sd₂²). Of two recordings of the same motor, 1 figure in 20 lies more than 2 sd apart by chance, and 1 in 370 more than 3.`) : null,
    ].filter(Boolean);
}

// Of a result that isn't trusted its standard deviations aren't, either.
function doubts(columns) {
    const doubtful = columns.filter(({ result }) => result.verdict === "doubtful").map(({ name }) => name);
    if (!doubtful.length) return null;
    const [be, its, report] = doubtful.length > 1 ? ["are", "their", "Their reports say"] : ["is", "its", "Its report says"];
    return el("li", {}, `${listed(doubtful)} ${be} doubtful: ${its} intervals may be too narrow, and differences smaller than they look. ${report} why.`);
}

const heading = ({ name }, k) => el("th", { scope: "col", class: `key-${k}` }, el("span", { class: "swatch", "aria-hidden": "true" }), name);

// The usual ones first, then whatever else a model has.
function quantities(all) {
    const there = new Set(all.flatMap((parameters) => Object.keys(parameters ?? {})));
    return [...FIRST.filter((name) => there.has(name)), ...[...there].filter((name) => !FIRST.includes(name))];
}

function verdicts(columns, start) {
    const cells = columns.map(({ name, about, going, spoilt, result, trouble }) => {
        if (spoilt && !result) return el("td", {}, el("p", { class: "trouble" }, "Its file can't be read"));
        if (trouble) return el("td", {}, el("p", { class: "trouble" }, trouble), identifyButton(name, about, going, start, "Identify again"));
        if (!result) return el("td", {}, el("p", { class: "quiet" }, "Not identified yet"), identifyButton(name, about, going, start, "Identify"));
        return el(
            "td",
            {},
            el("p", { class: "verdict", "data-level": LEVELS[result.verdict] ?? "off" }, shape(), words(result.verdict)),
            el("p", { class: "quiet" }, result.structure ? words(plainly(result.structure)) : "no model"),
            el("a", { class: "report", href: result.report, target: "_blank", rel: "noopener", "aria-label": `Open the report of ${name}` }, "Report"),
        );
    });
    return el("tr", {}, el("th", { scope: "row" }, "Verdict"), cells);
}

function identifyButton(name, about, going, start, title) {
    const id = `models-${slug(name)}`;
    const unclear = about?.columns === "open";
    const button = el(
        "button",
        { type: "button", class: "plain", id, "aria-disabled": String(Boolean(going)), "aria-label": unclear ? `Choose the columns of ${name}` : `${title} ${name}`, on: { click: () => start(name) } },
        unclear ? "Choose its columns" : going ? "Identifying …" : title,
    );
    return el("div", {}, button, el("p", { class: "quiet number", id: `${id}-progress` }, going ? workProgress(going).sentence : ""));
}

// One quantity of all models, as a row; `differences` are those to the first one's, by name of the recording.
function quantity(key, columns, usable) {
    const title = words(key);
    const found = columns.map((column) => (usable(column) ? column.result.parameters?.[key] : undefined));
    const there = found.filter(Boolean);
    const short = there.filter(isTold).every(({ unit, value }) => unit === "s" && Math.abs(value) < MILLI) && there.some(isTold);
    const [factor, units] = short ? [1000, ["ms"]] : [1, [...new Set(there.map(({ unit }) => unit))]];
    const differences = new Map();
    const cells = columns.map((column, k) => {
        if (!usable(column)) return el("td", { class: "quiet" }, "–");
        const parameter = found[k];
        if (!parameter) return el("td", { class: "quiet" }, "not in its model");
        const unit = units.length > 1 ? ` ${parameter.unit}` : "";
        const value = el("p", { class: "number" }, `${withInterval(parameter, factor)}${unit}`);
        if (k === 0 || !usable(columns[0])) return el("td", {}, value);
        const apart = { title, ...difference(found[0], parameter) };
        differences.set(column.name, apart);
        return el("td", {}, value, el("p", { class: "apart", "data-level": apart.level }, shape(), apart.words));
    });
    for (const { name } of columns) if (!differences.has(name)) differences.set(name, { title, level: "off", z: null });
    const head = el("th", { scope: "row" }, title, units.length === 1 && units[0] !== "1" ? el("span", { class: "unit" }, ` ${units[0]}`) : null);
    return { element: el("tr", {}, head, cells), differences };
}

// A value with its interval, as many digits as that allows: two of its half.
export function withInterval(parameter, factor = 1) {
    if (!isTold(parameter)) return "not determined by the data";
    const value = factor * parameter.value;
    const [low, high] = parameter.interval.map((end) => factor * end);
    const half = (high - low) / 2;
    if (!(half > 0)) return significant(value);
    const digits = Math.min(12, Math.max(0, 1 - Math.floor(Math.log10(half))));
    if (Math.abs(value - (low + high) / 2) > EVEN * half) return `${fixed(value, digits)} (${fixed(low, digits)} to ${fixed(high, digits)})`;
    return `${fixed(value, digits)} ± ${fixed(half, digits)}`;
}
