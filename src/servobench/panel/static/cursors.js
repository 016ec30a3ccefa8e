// Two cursors: what traces are at them, and by how much they differ.

import { indexAt } from "./frames.js";

// A trace at a time, interpolated between its rows; NaN outside of them.
export function valueAt(t, y, time) {
    const n = t.length;
    if (n === 0 || time < t[0] || time > t[n - 1]) return NaN;
    const k = indexAt(t, time);
    if (k === 0 || t[k] === time) return y[k];
    const share = (time - t[k - 1]) / (t[k] - t[k - 1]);
    return y[k - 1] + share * (y[k] - y[k - 1]);
}

// {span [s], rate [1/s], rows: [{a, b, difference, slope}]} for cursors at times a and b.
export function differences(t, traces, a, b) {
    const span = b - a;
    const rows = traces.map((y) => {
        const [atA, atB] = [valueAt(t, y, a), valueAt(t, y, b)];
        return { a: atA, b: atB, difference: atB - atA, slope: (atB - atA) / span };
    });
    return { span, rate: 1 / span, rows };
}
