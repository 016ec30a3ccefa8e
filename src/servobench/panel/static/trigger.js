// Where a trace crosses a level, as an oscilloscope's trigger looks for it.

import { indexAt } from "./frames.js";

// The time of the last crossing in t[from, to), or NaN. The trace has to have been `hysteresis` beyond the level on the side that
// it comes from, so that noise about the level isn't taken for a crossing. Between two rows the time is interpolated.
export function lastCrossing(t, y, { level, rising, hysteresis = 0 }, from = 0, to = t.length) {
    const sign = rising ? 1 : -1;
    let found = NaN;
    let armed = false;
    for (let k = from; k < to; k++) {
        const above = sign * (y[k] - level);
        if (armed && above >= 0) {
            const before = sign * (y[k - 1] - level);
            const share = above === before ? 0 : -before / (above - before);
            found = t[k - 1] + share * (t[k] - t[k - 1]);
            armed = false;
        }
        if (above < -hysteresis || (hysteresis === 0 && above < 0)) armed = true;
        if (Number.isNaN(above)) armed = false;
    }
    return found;
}

// The last crossing whose whole sweep, `span` [s] with the share `pre` before the crossing, is in the data; NaN where there is none.
export function lastSweep(data, trace, settings) {
    const { span, pre } = settings;
    const t = data.t;
    if (t.length < 2) return NaN;
    const from = indexAt(t, t[0] + pre * span);
    const to = indexAt(t, t[t.length - 1] - (1 - pre) * span);
    return lastCrossing(t, data[trace], settings, from, to);
}
