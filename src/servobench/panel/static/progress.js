// What goes on for a while: a bar, what is done, how long it has taken and will take, and a way to end it.

import { el, say } from "./dom.js";
import { clock } from "./format.js";

// {element, show({share, text}), end()}; `share` is null where nobody knows. What takes less than a second never shows.
export function makeProgress(label, onEnd) {
    const bar = el("progress", { max: 1, "aria-label": label });
    const text = el("span", { class: "quiet number", role: "status" });
    const end = el("button", { type: "button", class: "plain", "aria-label": `End: ${label}`, on: { click: onEnd } }, "End");
    const element = el("div", { class: "progress", role: "group", "aria-label": label, hidden: true }, bar, text, end);
    const timer = setTimeout(() => (element.hidden = false), 1000);
    const show = ({ share, sentence }) => {
        if (share === null) bar.removeAttribute("value");
        else bar.value = share;
        say(text, sentence);
    };
    const over = () => {
        clearTimeout(timer);
        element.remove();
    };
    return { element, show, over };
}

// How far an identification is, in words and as a share: how long it will take where that is known, or else which step it is at.
export function workProgress({ doing, step, of, seconds, left }) {
    const known = left != null;
    const rest = known ? `about ${clock(Math.max(1, Math.ceil(left)))} left` : `${clock(seconds)} so far`;
    const place = !known && step ? `step ${step} of ${of}: ` : "";
    return { share: known ? seconds / (seconds + left) : null, sentence: `${place}${doing}  ·  ${rest}` };
}

// How far a file is on its way; `begun` is when it was sent [ms].
export function uploadProgress(sent, total, begun) {
    const seconds = (performance.now() - begun) / 1000;
    const share = total ? sent / total : null;
    const left = sent > 0 && sent < total ? (seconds * (total - sent)) / sent : null;
    const rest = sent >= total ? "being read" : left === null ? "" : `about ${clock(Math.max(1, Math.ceil(left)))} left`;
    return { share: sent >= total ? null : share, sentence: [`${megabytes(sent)} of ${megabytes(total)}`, rest].filter(Boolean).join("  ·  ") };
}

export const megabytes = (bytes) => `${(bytes / 2 ** 20).toFixed(bytes < 10 * 2 ** 20 ? 1 : 0)} MB`;
