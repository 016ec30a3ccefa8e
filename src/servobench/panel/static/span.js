// The range of a scope's values: grows at once, shrinks only when half of it is empty, so that it doesn't breathe with noise.

const MARGIN = 0.12; // of what is shown, above and below
const LEAST = 0.04; // what has to be left of that, or a line lies on the edge, half cut off

export class Span {
    // `least`: values below it are as good as none, such as what a filter has left long after a motor came to rest.
    constructor(least = 0) {
        this.least = least;
        this.forget();
    }

    forget() {
        this.range = null;
    }

    // [min, max] that holds values from `low` to `high`.
    holding(low, high) {
        if (!(low <= high)) return this.range ?? [-1, 1];
        const most = Math.max(Math.abs(low), Math.abs(high));
        const small = most > this.least ? Math.max(1e-3 * most, this.least) : 1;
        const size = Math.max(high - low, small);
        const wanted = [low - MARGIN * size - (size - (high - low)) / 2, high + MARGIN * size + (size - (high - low)) / 2];
        const held = this.range;
        const left = LEAST * (high - low);
        const fits = held && low - left >= held[0] && high + left <= held[1];
        if (!fits || size < 0.4 * (held[1] - held[0])) this.range = wanted;
        return this.range;
    }
}
