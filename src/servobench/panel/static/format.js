// Numbers as people read them: a true minus sign, so many significant digits, and never a width that jumps.

const MINUS = "\u2212";

export function fixed(value, digits) {
    if (!Number.isFinite(value)) return "–";
    const text = value.toFixed(digits);
    return Number(text) === 0 ? (0).toFixed(digits) : text.replace("-", MINUS);
}

// With that many significant digits, without an exponent where it can be read without.
export function significant(value, digits = 4) {
    if (!Number.isFinite(value)) return "–";
    if (value === 0) return "0";
    const size = Math.floor(Math.log10(Math.abs(value)));
    if (size < -4 || size > 6) return value.toExponential(digits - 1).replaceAll("-", MINUS);
    return fixed(value, Math.max(0, digits - 1 - size));
}

// How many decimals write a step of an axis in full: 0 for 5, 1 for 2.5, 2 for 0.25.
export function decimals(step) {
    let digits = 0;
    while (digits < 9 && Math.abs(step * 10 ** digits - Math.round(step * 10 ** digits)) > 1e-6) digits += 1;
    return digits;
}

export function seconds(value) {
    if (!Number.isFinite(value)) return "–";
    if (Math.abs(value) < 1) return `${significant(value * 1000, 3)} ms`;
    return `${significant(value, 4)} s`;
}

// A parameter with its interval, short times in ms: a delay of 0.0001 s is no figure to read.
export function readable({ value, interval, unit }) {
    if (unit !== "s" || Math.abs(value) >= 0.01) return { value, interval, unit };
    return { value: 1000 * value, interval: interval?.map((end) => 1000 * end), unit: "ms" };
}

// A duration on a clock: 0:07.
export function clock(value) {
    const whole = Math.floor(value);
    return `${Math.floor(whole / 60)}:${String(whole % 60).padStart(2, "0")}`;
}

// A name from the library as words: time_constant → Time constant.
export function words(name) {
    const text = name.replaceAll("_", " ");
    return text.charAt(0).toUpperCase() + text.slice(1);
}

// A sentence with names from the library as words, too: first_order_one_way → first order one way.
export const plainly = (sentence) => sentence.replace(/\b[a-z]+(?:_[a-z0-9]+)+\b/g, (name) => name.replaceAll("_", " "));

// The meaning of a setting without the unit at its end, which stands beside the field.
export const meaning = (sentence) => (sentence ?? "").replace(/ \[[^\]]*\]\.?$/, ".");
