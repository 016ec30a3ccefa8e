// Binary frames, and the ring that keeps the last ten seconds of them.

export const MAGIC = 0x31425653; // "SVB1"
export const COLUMNS = [
    "t", "reference", "commanded", "applied", "counts", "position", "speed_raw", "speed", "current", "residual",
    "late", "saturated", "command",
];
const HEADER = 24; // bytes: four u32 and a f64

const littleEndian = new Uint8Array(new Uint32Array([1]).buffer)[0] === 1;

// {first: number of the first row, count, columns: {name: typed array}}; the arrays are views into the buffer.
export function decode(buffer) {
    if (!littleEndian) throw new Error("this machine's numbers have the other byte order; frames can't be read");
    if (buffer.byteLength < HEADER) throw new Error(`a frame of ${buffer.byteLength} bytes is shorter than its header`);
    const head = new DataView(buffer);
    if (head.getUint32(0, true) !== MAGIC) throw new Error("not a frame: it doesn't begin with SVB1");
    const count = head.getUint32(4, true);
    const wide = head.getUint32(8, true);
    const first = head.getFloat64(16, true);
    if (wide !== COLUMNS.length) throw new Error(`a frame has ${wide} columns; expected ${COLUMNS.length}`);
    const length = HEADER + 8 * count + 4 * count * (wide - 1);
    if (buffer.byteLength !== length) {
        throw new Error(`a frame of ${count} rows has ${buffer.byteLength} bytes; expected ${length}`);
    }
    const columns = { t: new Float64Array(buffer, HEADER, count) };
    COLUMNS.slice(1).forEach((name, k) => {
        columns[name] = new Float32Array(buffer, HEADER + 8 * count + 4 * count * k, count);
    });
    return { first, count, columns };
}

// Keeps the last `capacity` rows; `view` is always one piece of memory, so a scope draws it without a copy. Arrays are twice as
// long as needed, and the last half moves to the front when the end is reached.
export class Ring {
    constructor(capacity) {
        this.capacity = capacity;
        this.arrays = { t: new Float64Array(2 * capacity) };
        for (const name of COLUMNS.slice(1)) this.arrays[name] = new Float32Array(2 * capacity);
        this.clear();
    }

    clear() {
        this.end = 0;
        this.next = null; // number of the row that comes next
        this.gaps = []; // [time before, time after] of rows that are missing
    }

    get count() {
        return Math.min(this.end, this.capacity);
    }

    get last() {
        return this.end ? this.arrays.t[this.end - 1] : NaN;
    }

    append(frame) {
        if (frame.count === 0) return;
        const begins = frame.columns.t[0];
        // A run that began anew has times of its own.
        if (this.end && begins <= this.last) this.clear();
        if (this.next !== null && frame.first !== this.next && this.end) this.gaps.push([this.last, begins]);
        const taken = Math.min(frame.count, this.capacity);
        if (this.end + taken > 2 * this.capacity) this.moveToFront(this.capacity - taken);
        for (const name of COLUMNS) {
            const values = frame.columns[name];
            this.arrays[name].set(taken < frame.count ? values.subarray(frame.count - taken) : values, this.end);
        }
        this.end += taken;
        this.next = frame.first + frame.count;
        const oldest = this.arrays.t[this.end - this.count];
        this.gaps = this.gaps.filter(([, after]) => after > oldest);
    }

    moveToFront(kept) {
        const begin = this.end - Math.min(kept, this.end);
        for (const name of COLUMNS) this.arrays[name].copyWithin(0, begin, this.end);
        this.end -= begin;
    }

    // {t, columns..., gaps}: what is there now, without a copy.
    view() {
        const begin = this.end - this.count;
        const found = { gaps: this.gaps };
        for (const name of COLUMNS) found[name] = this.arrays[name].subarray(begin, this.end);
        return found;
    }
}

// The index of the first time that isn't before `time`.
export function indexAt(t, time) {
    let low = 0;
    let high = t.length;
    while (low < high) {
        const middle = (low + high) >> 1;
        if (t[middle] < time) low = middle + 1;
        else high = middle;
    }
    return low;
}

// A copy of the rows from one time to another, both included.
export function excerpt(data, from, to) {
    const begin = indexAt(data.t, from);
    let end = indexAt(data.t, to);
    if (data.t[end] === to) end += 1;
    const cut = { gaps: data.gaps.filter(([before, after]) => after > from && before < to) };
    for (const name of COLUMNS) cut[name] = data[name].slice(begin, end);
    return cut;
}
