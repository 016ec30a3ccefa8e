// A few recordings over each other, each from its own beginning, and what was identified from them side by side.

import { toast } from "./announcer.js";
import { bytes } from "./api.js";
import { byId, el } from "./dom.js";
import { decode } from "./frames.js";
import { decimals, fixed } from "./format.js";
import { makeModels } from "./models.js";

const MOST = 4;
const UNREADABLE = 422; // what rows of a file are answered with that can't be read at all
const DASHES = [undefined, [6, 3], [2, 3], [9, 3, 2, 3]]; // they differ for who sees no colours

const SHOWN = [
    { column: "applied", title: "Applied voltage", unit: "V" },
    { column: "speed", title: "Speed", unit: "rad/s" },
    { column: "position", title: "Position since the beginning", unit: "rad", since: true },
];
const token = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();

// The common times of recordings, and each one's values there (null outside): what uPlot wants to draw their lines. `since`
// counts a column from its first value on.
export function aligned(recordings, column, since = false) {
    const times = recordings.map(({ t }) => Float64Array.from(t, (time) => time - t[0]));
    const all = [...new Set(times.flatMap((t) => [...t]))].sort((a, b) => a - b);
    const place = new Map(all.map((time, k) => [time, k]));
    const columns = recordings.map((recording, r) => {
        const values = new Array(all.length).fill(undefined); // undefined: no gap, just no row of this recording's
        const begins = since ? (recording[column].find(Number.isFinite) ?? 0) : 0;
        times[r].forEach((time, k) => {
            const value = recording[column][k] - begins;
            values[place.get(time)] = Number.isFinite(value) ? value : null; // null: nobody knows it
        });
        return values;
    });
    return [all, ...columns];
}

// The rows of a recording from the last one before its voltage changes, all where it never does.
export function fromFirstChange(recording) {
    const { applied } = recording;
    const change = applied.findIndex((value, k) => k > 0 && value !== applied[k - 1] && Number.isFinite(value));
    if (change < 1) return recording;
    return Object.fromEntries(Object.entries(recording).map(([name, values]) => [name, values.subarray(change - 1)]));
}

export function makeCompare(show, store) {
    const chosen = [];
    const kept = new Map();
    const models = makeModels((name) => compare.identify(name));
    store.on("work", models.work);
    const compare = {
        onChange: () => {},
        identify: async () => false, // whether it went well
        know: models.know,
        has: (name) => chosen.includes(name),
        drop: (name) => {
            kept.delete(name);
            if (chosen.includes(name)) compare.toggle(name);
        },
        // A few at most: one more takes the first one's place.
        toggle: async (name) => {
            if (chosen.includes(name)) chosen.splice(chosen.indexOf(name), 1);
            else chosen.push(name);
            if (chosen.length > MOST) toast(`Four at a time: ${chosen.shift()} made room for ${name}.`);
            compare.onChange();
            if (chosen.length) show();
            await draw();
        },
    };
    const place = el("div", { class: "lines" });
    byId("compare").append(models.element, place);
    const together = el("input", { type: "checkbox", id: "compare-together", on: { change: () => draw() } });
    const choice = el("label", { class: "inline" }, together, el("span", {}, "Begin each where its voltage changes first"));
    let plots = [];
    const draw = async () => {
        const names = [...chosen];
        models.show(names);
        const found = await Promise.all(names.map((name, k) => lineOf(name, k, kept)));
        if (names.join() !== chosen.join()) return;
        models.spoilt(found.filter(({ error }) => error?.status === UNREADABLE).map(({ name }) => name));
        for (const plot of plots) plot.destroy();
        plots = [];
        const keys = found.map(({ name, k, error }) => el("span", { class: `key key-${k}` }, error ? null : el("span", { class: "swatch", "aria-hidden": "true" }), error ? `${name} (not drawn)` : name));
        const wrong = found.filter(({ error }) => error).map(({ name, error }) => el("p", { class: "trouble" }, `${name} can't be drawn: ${error.message}`));
        const hint = el("p", { class: "quiet none" }, "Tick up to four recordings to overlay them here and compare what was identified from them.");
        place.replaceChildren(names.length ? el("div", { class: "row between" }, el("p", { class: "keys" }, keys), choice) : hint);
        if (wrong.length) place.append(el("div", { role: "alert" }, wrong));
        const lines = found.filter(({ error }) => !error);
        const drawn = together.checked ? lines.map((line) => ({ ...line, rows: fromFirstChange(line.rows) })) : lines;
        if (lines.length) plots = SHOWN.map((shown) => plot(place, shown, drawn));
    };
    document.addEventListener("theme", draw);
    new ResizeObserver(() => plots.forEach((each) => each.setSize({ width: place.clientWidth - 2, height: each.height }))).observe(place);
    draw();
    return compare;
}

// {name, k, rows} of the k-th recording, or {name, k, error}: what is wrong with one is no reason to leave out the others.
async function lineOf(name, k, kept) {
    try {
        if (!kept.has(name)) kept.set(name, decode(await bytes(`/api/recordings/${encodeURIComponent(name)}/rows`)).columns);
    } catch (error) {
        return { name, k, error };
    }
    return { name, k, rows: kept.get(name) };
}

function plot(place, { column, title, unit, since }, lines) {
    const names = lines.map(({ name }) => name);
    const holder = el("div", { class: "canvas", role: "img", "aria-label": `${title} of ${names.length > 2 ? `${names.slice(0, -1).join(", ")} and ${names.at(-1)}` : names.join(" and ")} over time` });
    place.append(el("section", { class: "scope" }, el("header", {}, el("h3", {}, title), el("span", { class: "unit" }, unit)), holder));
    const grid = { stroke: token("--scope-grid"), width: 1 };
    const axis = { stroke: token("--scope-text"), font: "11px system-ui, sans-serif", ticks: { show: false }, grid };
    const series = lines.map(({ name, k }) => ({
        label: name,
        stroke: token(`--compare-${k}`),
        width: 1.5,
        dash: DASHES[k],
        points: { show: false },
    }));
    const options = {
        width: Math.max(200, place.clientWidth - 2),
        height: 190,
        legend: { show: false },
        scales: { x: { time: false } },
        cursor: { points: { show: false }, sync: { key: "compare" } },
        axes: [
            { ...axis, size: 24, values: (_, ticks) => ticks.map((v) => `${v} s`) },
            { ...axis, size: 58, values: (_, ticks) => ticks.map((v) => fixed(v, decimals(ticks.length > 1 ? ticks[1] - ticks[0] : v))) },
        ],
        series: [{}, ...series],
    };
    return new uPlot(options, aligned(lines.map(({ rows }) => rows), column, since), holder);
}
