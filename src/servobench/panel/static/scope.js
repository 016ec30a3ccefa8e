// One scope: uPlot with a calm frame, a legend whose entries are switches and readings, and lines for cursors and trigger.

import { el, say } from "./dom.js";
import { decimals, fixed } from "./format.js";
import { indexAt } from "./frames.js";
import { Span } from "./span.js";

const FONT = '11px ui-sans-serif, system-ui, "Segoe UI", Roboto, sans-serif';
const AXIS_WIDTH = 58;
const DASHES = { dashed: [7, 7], dotted: [2, 3] };
const WIDTHS = { thin: 1, wide: 3 }; // px

const token = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();

export class Scope {
    // `shared` is what all scopes have in common: {cursors, trigger, origin, onZoom, onKey, onCursor}.
    constructor(definition, shared) {
        this.definition = definition;
        this.shared = shared;
        this.traces = definition.traces.map((trace) => ({ ...trace, factor: 1, unit: "", there: true }));
        this.span = new Span(definition.least);
        this.last = false;
        this.plot = null;
        this.element = this.build();
    }

    build() {
        const { id, title } = this.definition;
        this.heading = el("h3", { id: `scope-${id}` }, title);
        this.unitText = el("span", { class: "unit" });
        this.legend = el("div", { class: "legend", role: "group", "aria-label": `${title}: traces` });
        for (const trace of this.traces) this.legend.append(this.entry(trace));
        this.canvas = el("div", {
            class: "canvas",
            role: "img",
            tabindex: "0",
            "aria-label": `${title} over time. Plus and minus zoom, arrows move, space pauses.`,
            on: { keydown: (event) => this.shared.onKey(event) },
        });
        const top = el("header", {}, this.heading, this.unitText, this.legend);
        return el("section", { class: "scope", "aria-labelledby": `scope-${id}` }, top, this.canvas);
    }

    entry(trace) {
        trace.reading = el("output", { class: "reading", "aria-live": "off" }, "–");
        const swatch = el("span", { class: `swatch ${trace.line ?? ""}`, "aria-hidden": "true" });
        trace.button = el(
            "button",
            {
                type: "button",
                class: "trace",
                "data-trace": trace.column,
                "aria-pressed": String(trace.shown),
                "aria-label": `${this.definition.title}, ${trace.title}: shown`,
                title: trace.note,
                on: { click: () => this.toggle(trace) },
            },
            swatch,
            el("span", {}, trace.title),
        );
        trace.reading.hidden = !trace.shown;
        trace.entry = el("span", { class: "entry" }, trace.button, trace.reading);
        return trace.entry;
    }

    toggle(trace) {
        trace.shown = !trace.shown;
        trace.reading.hidden = !trace.shown;
        trace.button.setAttribute("aria-pressed", String(trace.shown));
        this.span.forget();
        this.shared.onChange();
    }

    visible() {
        return this.traces.filter((trace) => trace.shown && trace.there);
    }

    // Anew, as the theme, the size of a pixel or the place in the stack changed.
    rebuild(last) {
        this.last = last;
        this.plot?.destroy();
        const colours = { grid: token("--scope-grid"), text: token("--scope-text") };
        const axis = { stroke: colours.text, font: FONT, ticks: { show: false }, grid: { stroke: colours.grid, width: 1 } };
        this.colours = { cursor: token("--cursor-line"), trigger: token("--accent"), gap: token("--scope-gap"), surface: token("--scope-ground") };
        const series = this.traces.map((trace) => ({
            label: trace.title,
            stroke: token(`--trace-${trace.column}`),
            width: WIDTHS[trace.line] ?? 1.75,
            dash: DASHES[trace.line],
            points: { show: false },
            show: trace.shown && trace.there,
            gaps: (plot, _series, _from, _to, found) => [...found, ...this.gapsIn(plot)],
        }));
        const options = {
            ...this.size(),
            legend: { show: false },
            scales: { x: { time: false, auto: false }, y: { auto: false } },
            padding: [6, 16, last ? 0 : 6, 0],
            axes: [
                {
                    ...axis,
                    size: last ? 24 : 0,
                    gap: 4,
                    space: 70,
                    splits: (_plot, _axis, min, max, step) => this.marks(min, max, step),
                    values: (_, ticks) => (last ? this.times(ticks) : ticks.map(() => "")),
                },
                { ...axis, size: AXIS_WIDTH, gap: 6, space: 26, values: (_, ticks) => ticks.map((v) => this.tick(v, ticks)) },
            ],
            cursor: { drag: { x: true, y: false, setScale: false }, points: { show: false }, y: false, sync: { key: "scopes" } },
            series: [{}, ...series],
            hooks: { setSelect: [(plot) => this.selected(plot)], drawClear: [(plot) => this.under(plot)], draw: [(plot) => this.over(plot), () => this.shared.onDrawn(this)] },
        };
        this.plot = new uPlot(options, [[], ...this.traces.map(() => [])], this.canvas);
        this.plot.over.addEventListener("dblclick", () => this.shared.onZoom(null));
        this.plot.over.addEventListener("pointerdown", (event) => this.shared.onPointer(event, this.plot), { capture: true });
        this.span.forget();
    }

    size() {
        return { width: Math.max(120, this.canvas.clientWidth), height: Math.max(60, this.canvas.clientHeight) };
    }

    resize() {
        this.plot?.setSize(this.size());
    }

    // Round times from the origin on, which is the trigger where there is one.
    marks(min, max, step) {
        const { origin } = this.shared;
        const made = [];
        for (let k = Math.ceil((min - origin) / step); origin + k * step <= max; k++) made.push(origin + k * step);
        return made;
    }

    times(ticks) {
        const digits = decimals(ticks.length > 1 ? ticks[1] - ticks[0] : 1);
        return ticks.map((time, k) => `${fixed(time - this.shared.origin, digits)}${k === ticks.length - 1 ? " s" : ""}`);
    }

    tick(value, ticks) {
        return fixed(value, decimals(ticks.length > 1 ? ticks[1] - ticks[0] : value));
    }

    // Draw the rows between two times; `data` is the ring's view or an excerpt.
    draw(data, from, to) {
        this.data = data;
        const begin = Math.max(0, indexAt(data.t, from) - 1);
        const end = Math.min(data.t.length, indexAt(data.t, to) + 1);
        let [low, high] = [Infinity, -Infinity];
        const columns = this.traces.map((trace) => {
            const y = this.scaled(trace, data[trace.column], begin, end);
            if (trace.shown && trace.there) {
                for (let k = 0; k < y.length; k++) {
                    if (y[k] < low) low = y[k];
                    if (y[k] > high) high = y[k];
                }
            }
            return y;
        });
        const [min, max] = this.span.holding(low, high);
        this.plot.batch(() => {
            this.plot.setData([data.t.subarray(begin, end), ...columns], false);
            this.traces.forEach((trace, k) => {
                const show = trace.shown && trace.there;
                if (this.plot.series[k + 1].show !== show) this.plot.setSeries(k + 1, { show });
            });
            this.plot.setScale("x", { min: from, max: to });
            this.plot.setScale("y", { min, max });
        });
    }

    // The trace in the unit that it's shown in, without a copy where that is its own.
    scaled(trace, y, begin, end) {
        if (trace.factor === 1) return y.subarray(begin, end);
        const count = end - begin;
        if (!trace.buffer || trace.buffer.length < count) trace.buffer = new Float32Array(2 * count);
        for (let k = 0; k < count; k++) trace.buffer[k] = trace.factor * y[begin + k];
        return trace.buffer.subarray(0, count);
    }

    // Say what traces are now. A trace whose newest value is none isn't measured here.
    read(data) {
        for (const trace of this.traces) {
            const y = data[trace.column];
            const value = y.length ? trace.factor * y[y.length - 1] : NaN;
            say(trace.reading, Number.isFinite(value) ? fixed(value, this.digits(trace)) : "–");
        }
    }

    digits(trace) {
        if (trace.unit === "counts") return 0;
        return { V: 2, A: 3, rad: 3, deg: 1, "rad/s": 2 }[trace.unit] ?? 3;
    }

    gapsIn(plot) {
        return (this.data?.gaps ?? []).map(([before, after]) => [plot.valToPos(before, "x", true), plot.valToPos(after, "x", true)]);
    }

    selected(plot) {
        const { left, width } = plot.select;
        if (width < 4) return;
        plot.setSelect({ left: 0, width: 0, top: 0, height: 0 }, false);
        this.shared.onZoom([plot.posToVal(left, "x"), plot.posToVal(left + width, "x")]);
    }

    // Missing rows, behind the traces.
    under(plot) {
        const { left, top, width, height } = plot.bbox;
        plot.ctx.fillStyle = this.colours.gap;
        for (const [from, to] of this.gapsIn(plot)) {
            const [a, b] = [Math.max(from, left), Math.min(to, left + width)];
            if (b > a) plot.ctx.fillRect(a, top, Math.max(1, b - a), height);
        }
    }

    // Cursors and the trigger's point, over the traces.
    over(plot) {
        const { ctx, bbox } = plot;
        const { cursors, trigger } = this.shared;
        ctx.save();
        ctx.lineWidth = devicePixelRatio;
        ctx.setLineDash([]); // the last trace's dashes are none of theirs
        if (cursors) {
            cursors.forEach((time, k) => this.line(plot, time, "AB"[k]));
        }
        if (trigger) {
            ctx.strokeStyle = ctx.fillStyle = this.colours.trigger;
            const x = plot.valToPos(trigger.time, "x", true);
            ctx.setLineDash([2 * devicePixelRatio, 4 * devicePixelRatio]);
            if (Number.isFinite(x)) stroke(ctx, x, bbox.top, x, bbox.top + bbox.height);
            if (this.traces.some((trace) => trace.column === trigger.trace && trace.shown && (!trace.follows || trace.there))) {
                const factor = this.traces.find((trace) => trace.column === trigger.trace).factor;
                const y = plot.valToPos(trigger.level * factor, "y", true);
                if (y >= bbox.top && y <= bbox.top + bbox.height) stroke(ctx, bbox.left, y, bbox.left + bbox.width, y);
            }
        }
        ctx.restore();
    }

    line(plot, time, name) {
        const { ctx, bbox } = plot;
        const x = Math.round(plot.valToPos(time, "x", true));
        if (!(x >= bbox.left && x <= bbox.left + bbox.width)) return;
        const size = 14 * devicePixelRatio;
        ctx.strokeStyle = ctx.fillStyle = this.colours.cursor;
        stroke(ctx, x, bbox.top, x, bbox.top + bbox.height);
        ctx.fillRect(x - size / 2, bbox.top, size, size);
        ctx.fillStyle = this.colours.surface;
        ctx.font = `600 ${10 * devicePixelRatio}px system-ui, sans-serif`;
        ctx.textAlign = "center";
        ctx.textBaseline = "middle";
        ctx.fillText(name, x, bbox.top + size / 2 + devicePixelRatio / 2);
    }
}

function stroke(ctx, x1, y1, x2, y2) {
    ctx.beginPath();
    ctx.moveTo(x1, y1);
    ctx.lineTo(x2, y2);
    ctx.stroke();
}
