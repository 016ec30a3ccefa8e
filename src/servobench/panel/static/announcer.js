// What is told to who can't see the page: one sentence at a time, not more often than every second, the last one wins.

import { byId } from "./dom.js";

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

// A sentence for everybody, for some seconds, maybe with one thing to do about it.
let hiding = 0;
export function toast(sentence, action = null) {
    const place = byId("toast");
    place.replaceChildren(sentence);
    if (action) {
        const button = document.createElement("button");
        button.type = "button";
        button.textContent = action.title;
        button.addEventListener("click", () => {
            place.hidden = true;
            action.run();
        });
        place.append(button);
    }
    place.hidden = false;
    clearTimeout(hiding);
    hiding = setTimeout(() => (place.hidden = true), action ? 12000 : 6000);
}
