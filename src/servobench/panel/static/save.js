// What is seen, as a table (CSV) and as a picture (PNG).

import { excerpt } from "./frames.js";

const token = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();

// The shown traces of the shown scopes, in the range that is shown, as a text; times in s, values with all digits that came.
export function table(scopes, { data, from, to }) {
    const cut = excerpt(data, from, to);
    const traces = scopes.flatMap((scope) => scope.visible().map((trace) => ({ ...trace, scope: scope.definition.title })));
    const names = new Set();
    const columns = traces.filter((trace) => !names.has(trace.column) && names.add(trace.column));
    const lines = [["t [s]", ...columns.map((trace) => `${trace.column} [${trace.unit}]`)].join(",")];
    for (let k = 0; k < cut.t.length; k++) {
        const values = columns.map((trace) => digits(trace.factor * cut[trace.column][k]));
        lines.push([String(cut.t[k]), ...values].join(","));
    }
    return `${lines.join("\r\n")}\r\n`;
}

// Nine significant digits tell any two float32 apart.
const digits = (value) => (Number.isFinite(value) ? String(Number(value.toPrecision(9))) : "");

// The shown scopes below each other, with their titles and traces.
export function picture(scopes) {
    const ratio = devicePixelRatio;
    const head = 26 * ratio;
    const canvases = scopes.map((scope) => scope.plot.ctx.canvas);
    const made = document.createElement("canvas");
    made.width = Math.max(...canvases.map((canvas) => canvas.width)) + 24 * ratio;
    made.height = canvases.reduce((sum, canvas) => sum + canvas.height + head, 12 * ratio);
    const ctx = made.getContext("2d");
    ctx.fillStyle = token("--scope-ground");
    ctx.fillRect(0, 0, made.width, made.height);
    let y = 0;
    scopes.forEach((scope, k) => {
        label(ctx, scope, 14 * ratio, y + head / 2, ratio);
        ctx.drawImage(canvases[k], 12 * ratio, y + head);
        y += head + canvases[k].height;
    });
    return new Promise((resolve) => made.toBlob(resolve, "image/png"));
}

function label(ctx, scope, x, y, ratio) {
    ctx.textBaseline = "middle";
    ctx.textAlign = "left";
    ctx.font = `600 ${12 * ratio}px system-ui, sans-serif`;
    const parts = [[`${scope.definition.title} [${scope.visible()[0]?.unit ?? ""}]`, token("--ink")]];
    for (const trace of scope.visible()) parts.push([trace.title, token(`--trace-${trace.column}`)]);
    for (const [text, colour] of parts) {
        ctx.fillStyle = colour;
        ctx.fillText(text, x, y);
        x += ctx.measureText(text).width + 16 * ratio;
    }
}

export function saveAs(blob, name) {
    const link = document.createElement("a");
    link.href = URL.createObjectURL(blob);
    link.download = name;
    link.click();
    setTimeout(() => URL.revokeObjectURL(link.href), 10000);
}
