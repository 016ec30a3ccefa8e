// A signal drawn before it's applied, as the loop would put it out: how far it goes in each column, so that none is too fast to be seen.

import { post } from "./api.js";
import { el, say, shape } from "./dom.js";
import { fixed, significant } from "./format.js";

const [WIDTH, HEIGHT, PAD] = [280, 60, 6];
const SVG = "http://www.w3.org/2000/svg";
const ROUNDING = 1e-9; // V, rad or whatever it's in: less than that is what is left of a zero
const MISTAKE = "Not shown: the form has a mistake.";

// A line [[x, y], ...] through the least and the largest value of each column, from `t[k]` to `t[k + 1]`; a column without any
// begins it anew, as null. A value that holds is level; of two, the one that is nearer to where the line is comes first.
export function outline({ t, low, high }) {
    const line = [];
    let at = null;
    low.forEach((least, k) => {
        const most = high[k];
        if (least === null || most === null) {
            if (at !== null) line.push(null);
            at = null;
            return;
        }
        const rising = at === null || Math.abs(least - at) <= Math.abs(most - at);
        const ends = rising ? [least, most] : [most, least];
        line.push([t[k], ends[0]], [t[k + 1], ends[1]]);
        at = ends[1];
    });
    return line;
}

// "−2.00 to 4.00": with as many digits as the range has use for.
export function rangeWords(low, high) {
    if (!(low <= high)) return "not a number that can be drawn";
    const size = Math.max(Math.abs(low), Math.abs(high));
    if (size < ROUNDING) return "0 to 0";
    const range = high - low > ROUNDING * size ? high - low : size;
    const digits = 2 - Math.floor(Math.log10(range));
    const plain = size < 1e6 && digits < 7;
    const told = (value) => (plain ? fixed(value, Math.max(0, digits)) : Math.abs(value) < 0.005 * range ? "0" : significant(value, 3));
    return `${told(low)} to ${told(high)}`;
}

// What a preview says: how far the signal goes, and what of it isn't shown.
export function caption({ low, high, unit, duration, length, later }) {
    const known = (values) => values.filter((v) => v !== null);
    const range = rangeWords(least(known(low)), most(known(high)));
    if (duration >= length) return `${range} ${unit} over ${significant(duration, 3)} s`;
    const rest = later ? `later it goes from ${rangeWords(...later)} ${unit}` : "what comes later isn't shown";
    return `${range} ${unit} over the first ${significant(duration, 4)} s of ${significant(length, 4)} s; ${rest}`;
}

const least = (values) => values.reduce((a, b) => Math.min(a, b), Infinity);
const most = (values) => values.reduce((a, b) => Math.max(a, b), -Infinity);

export class Preview {
    constructor() {
        this.drawing = document.createElementNS(SVG, "svg");
        this.drawing.setAttribute("viewBox", `0 0 ${WIDTH} ${HEIGHT}`);
        this.drawing.setAttribute("role", "img");
        this.drawing.setAttribute("preserveAspectRatio", "none");
        this.zero = this.drawing.appendChild(document.createElementNS(SVG, "path"));
        this.zero.setAttribute("class", "zero");
        this.line = this.drawing.appendChild(document.createElementNS(SVG, "path"));
        this.caption = el("figcaption", {});
        this.absent = el("p", { class: "quiet absent", "aria-live": "polite" });
        this.warnings = el("ul", { class: "doubts", role: "status" });
        this.element = el("figure", { class: "preview" }, this.drawing, this.caption, this.absent, this.warnings);
        this.turn = 0;
        this.clear("");
    }

    // What is drawn is no longer what the form says; whatever was asked for comes too late.
    age() {
        this.turn += 1;
        this.element.classList.add("aged");
    }

    // Nothing is drawn, and why.
    clear(why = MISTAKE) {
        this.turn += 1;
        this.element.classList.remove("aged");
        this.line.setAttribute("d", "");
        this.zero.setAttribute("d", "");
        this.caption.textContent = "";
        this.warnings.replaceChildren();
        say(this.absent, why);
        this.drawing.setAttribute("aria-label", `Preview. ${why}`);
    }

    // Resolves to the sentence that says what is wrong, or null.
    async show(signal, duration) {
        this.age();
        const turn = this.turn;
        let found;
        try {
            found = await post("/api/preview", { signal, duration });
        } catch (error) {
            if (turn !== this.turn) return null;
            this.clear(error.status === 400 ? MISTAKE : "Not shown: the server doesn't say what it looks like.");
            return error.message;
        }
        if (turn !== this.turn) return null;
        this.draw(found);
        return null;
    }

    draw(found) {
        const numbers = [...found.low, ...found.high].filter((v) => v !== null);
        const [bottom, top] = [Math.min(least(numbers), 0), Math.max(most(numbers), 0)];
        const x = (time) => (WIDTH * time) / found.t.at(-1);
        const y = (v) => PAD + (HEIGHT - 2 * PAD) * (1 - (v / 2 - bottom / 2) / (top / 2 - bottom / 2 || 1)); // halves: their difference is a number
        let mark = "M";
        const path = outline(found).map((point) => {
            const piece = point ? `${mark}${x(point[0]).toFixed(2)} ${y(point[1]).toFixed(2)}` : "";
            mark = point ? "L" : "M";
            return piece;
        });
        this.line.setAttribute("d", path.join(""));
        this.zero.setAttribute("d", `M0 ${y(0).toFixed(2)}H${WIDTH}`);
        this.warnings.replaceChildren(...found.warnings.map((each) => el("li", { "data-level": "warn" }, shape(), el("span", {}, each))));
        this.caption.textContent = caption(found);
        say(this.absent, "");
        this.drawing.setAttribute("aria-label", `Preview: ${this.caption.textContent}`);
        this.element.classList.remove("aged");
    }
}
