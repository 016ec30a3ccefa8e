// All scopes, one above the other, with the same time below them: drawn when something new is there, once for each picture.

import { byId } from "./dom.js";
import { Ring } from "./frames.js";
import { picture, saveAs, table } from "./save.js";
import { Scope } from "./scope.js";
import { ANGLES, referenceUnit, SCOPES } from "./traces.js";
import { HISTORY, View } from "./view.js";

const NOTHING = new Ring(1).view();
const READING_INTERVAL = 200; // ms; digits that change faster can't be read

export class Scopes {
    constructor(store) {
        this.store = store;
        this.ring = new Ring(HISTORY * 1000);
        this.view = new View(this.ring);
        this.angle = "rad";
        this.changed = true;
        this.read = 0;
        this.taken = -Infinity; // when rows came last [ms]
        this.old = false;
        this.pending = new Set(); // scopes that are being drawn
        this.reached = 0; // the number of the row after the newest one that they show then
        this.onFrame = () => {}; // for each picture, with the number of the row after the newest one that it shows
        this.onView = () => {};
        this.shared = {
            origin: 0,
            cursors: null,
            trigger: null,
            onZoom: (range) => this.act(() => this.view.zoom(range)),
            onKey: (event) => this.key(event),
            onPointer: (event, plot) => this.pointer(event, plot),
            onChange: () => this.layOut(),
            onDrawn: (scope) => this.finish(scope),
        };
        this.scopes = SCOPES.map((definition) => Object.assign(new Scope(definition, this.shared), { shown: definition.shown }));
        for (const scope of this.scopes) byId("stack").append(scope.element);
        document.addEventListener("theme", () => this.layOut());
        new ResizeObserver(() => this.resize()).observe(byId("stack"));
        this.setUnits();
        this.layOut();
        requestAnimationFrame(() => this.frame());
    }

    visible() {
        return this.scopes.filter((scope) => scope.shown);
    }

    // The ring for another sample time; what it held belongs to the run before.
    setSampleTime(sampleTime) {
        const capacity = Math.ceil(HISTORY / sampleTime);
        if (capacity === this.ring.capacity) return;
        this.ring = this.view.ring = new Ring(capacity);
        this.view.swept = null;
        this.changed = true;
    }

    take(frame) {
        this.taken = performance.now();
        const before = this.ring.last;
        this.ring.append(frame);
        if (this.ring.last < before) this.view.swept = null; // another run, with times of its own
        this.changed = true;
    }

    setUnits(controller = this.store.state?.controller) {
        const reference = referenceUnit(controller);
        const angle = ANGLES[this.angle];
        for (const scope of this.scopes) {
            for (const trace of scope.traces) this.setUnit(scope, trace, reference, angle);
            const shown = scope.traces.find((trace) => trace.there);
            scope.unitText.textContent = shown?.unit ?? "";
            scope.span.forget();
        }
        this.changed = true;
    }

    setUnit(scope, trace, reference, angle) {
        const { unit } = scope.definition;
        if (trace.follows) trace.there = trace.follows === reference;
        trace.unit = unit === "angle" ? angle.unit : unit;
        trace.factor = unit === "angle" ? (angle.factor ?? 1) : 1;
        if (unit !== "angle" || this.angle !== "counts") {
            if (trace.column === "counts") trace.column = "position";
        } else if (trace.column === "position") trace.column = "counts";
        else if (trace.column === "residual") trace.unit = "rad";
        else if (trace.follows) trace.there = false; // a reference has no counts
        trace.entry.hidden = !trace.there;
    }

    // Which scopes stand where; only the lowest has times below it.
    layOut() {
        const visible = this.visible();
        this.pending.clear();
        for (const scope of this.scopes) {
            scope.element.hidden = !scope.shown;
            scope.element.classList.toggle("last", scope === visible.at(-1));
        }
        for (const scope of visible) scope.rebuild(scope === visible.at(-1));
        this.changed = true;
    }

    // What was read last isn't read any more, once it isn't so: nothing new has come.
    setOld(old) {
        if (old === this.old) return;
        this.old = old;
        byId("old").hidden = !old;
        for (const scope of this.scopes) scope.read(this.newest());
        this.onRead?.(this.view.shown(), this.newest());
    }

    // The rows that readings are taken from; none where they are old.
    newest() {
        return this.old ? NOTHING : this.ring.view();
    }

    resize() {
        for (const scope of this.visible()) scope.resize();
        this.changed = true;
    }

    act(change) {
        change();
        this.changed = true;
        this.onView();
    }

    setSpan(span) {
        this.act(() => {
            this.view.span = span;
            this.view.swept = null;
            if (this.view.paused) {
                const to = this.view.range[1];
                this.view.zoom([to - span, to]);
            }
        });
    }

    key(event) {
        const actions = {
            "+": () => this.view.scale(0.5),
            "=": () => this.view.scale(0.5),
            "-": () => this.view.scale(2),
            ArrowLeft: () => this.view.move(-0.1),
            ArrowRight: () => this.view.move(0.1),
            Home: () => this.view.zoom(null),
            " ": () => (this.view.paused ? this.view.resume() : this.view.pause()),
        };
        if (!(event.key in actions) || event.ctrlKey || event.metaKey || event.altKey) return;
        event.preventDefault();
        this.act(actions[event.key]);
    }

    // A cursor that is pressed upon is moved; elsewhere a drag zooms.
    pointer(event, plot) {
        if (!this.view.cursors) return;
        const box = plot.over.getBoundingClientRect();
        const share = (at) => Math.min(1, Math.max(0, (at.clientX - box.left) / box.width));
        const near = this.view.cursors.map((place) => Math.abs(place - share(event)) * box.width);
        const which = near[0] <= near[1] ? 0 : 1;
        if (near[which] > 10) return;
        event.stopPropagation();
        const stopMouse = (mouse) => mouse.stopPropagation();
        plot.over.addEventListener("mousedown", stopMouse, { capture: true, once: true });
        const move = (at) => this.act(() => (this.view.cursors[which] = share(at)));
        window.addEventListener("pointermove", move);
        window.addEventListener("pointerup", () => window.removeEventListener("pointermove", move), { once: true });
    }

    frame() {
        requestAnimationFrame(() => this.frame());
        if (this.changed && !byId("view-scopes").hidden) this.draw();
        else if (!this.pending.size) this.onFrame(this.ring.next ?? 0);
    }

    // uPlot draws when the frame's own code is over, and each scope says when that is done: where it fails nothing is said.
    finish(scope) {
        if (this.pending.delete(scope) && !this.pending.size) this.onFrame(this.reached);
    }

    draw() {
        this.changed = false;
        this.reached = this.ring.next ?? 0;
        this.pending = new Set(this.visible());
        if (this.view.sweep() && !this.view.armed) this.onView();
        const shown = this.view.shown();
        Object.assign(this.shared, { origin: shown.origin, trigger: shown.trigger, cursors: this.view.cursorTimes() });
        for (const scope of this.visible()) scope.draw(shown.data, shown.from, shown.to);
        const now = performance.now();
        if (now - this.read < READING_INTERVAL) return;
        this.read = now;
        const newest = this.newest();
        for (const scope of this.visible()) scope.read(newest);
        this.onRead?.(shown, newest);
    }

    saveTable() {
        saveAs(new Blob([table(this.visible(), this.view.shown())], { type: "text/csv" }), "servobench-scopes.csv");
    }

    async savePicture() {
        saveAs(await picture(this.visible()), "servobench-scopes.png");
    }

    // What the cursors stand upon: times, and the shown traces with their data.
    underCursors() {
        const times = this.view.cursorTimes();
        if (!times) return null;
        const { data, origin } = this.view.shown();
        const traces = this.visible().flatMap((scope) => scope.visible().map((trace) => ({ scope, trace })));
        return { times, origin, data, traces };
    }
}

