// What is told to who can't see the page: one sentence at a time, not more often than every second, the last one wins.

import { byId, el } from "./dom.js";

const PAUSE = 1000; // ms
let waiting = null;
let told = -Infinity;
let timer = 0;

export function announce(sentence) {
    waiting = sentence;
    clearTimeout(timer);
    timer = setTimeout(tell, Math.max(0, told + PAUSE - performance.now()));
}

function tell() {
    told = performance.now();
    byId("announcer").textContent = waiting;
}

const MOST = 4; // sentences at once; the oldest goes

// A sentence for everybody, below those that are there: for some seconds, maybe with one thing to do about it. Returns what takes it away.
export function toast(sentence, action = null) {
    const place = show(sentence, action);
    setTimeout(() => place.remove(), action ? 12000 : 6000);
    return () => place.remove();
}

// A sentence about what went wrong: there until it's closed, as it says what to do.
export function complain(sentence, action = null) {
    show(sentence, action).classList.add("wrong");
}

function show(sentence, action) {
    const stack = byId("toast");
    const same = [...stack.children].find((each) => each.firstChild.textContent === sentence);
    same?.remove();
    const button = (title, run, extra = {}) => el("button", { type: "button", on: { click: () => (place.remove(), run()) }, ...extra }, title);
    const place = el(
        "div",
        { class: "toast" },
        el("span", {}, sentence),
        action ? button(action.title, action.run) : null,
        button("×", () => {}, { class: "square", "aria-label": "Close this message" }),
    );
    stack.append(place);
    while (stack.children.length > MOST) stack.firstChild.remove();
    return place;
}
