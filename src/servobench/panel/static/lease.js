// Who drives: one operator at a time. A page that comes to a free panel takes it; a later one watches, and may STOP.

import { byId, say } from "./dom.js";
import { complain } from "./announcer.js";

export function makeLease(store, commands) {
    const button = byId("lease");
    let first = true;
    const ask = async (message) => {
        const outcome = await commands.ask(message);
        if (!outcome.accepted) complain(outcome.why);
    };
    button.addEventListener("click", () => ask({ do: store.state.operator ? "release" : "lease" }));
    store.on("link", (status) => {
        if (status === "lost") first = true;
    });
    store.on("state", (state) => {
        if (state.unknown) {
            button.hidden = true;
            return say(byId("lease-text"), "It isn't known who drives");
        }
        if (first && !state.taken && store.mayDrive) ask({ do: "lease" });
        first = false;
        button.hidden = (!state.operator && state.taken) || !store.mayDrive;
        say(button, state.operator ? "Release" : "Take control");
        say(byId("lease-text"), who(state, store.mayDrive));
        document.body.classList.toggle("watching", !state.operator);
    });
}

function who({ operator, taken }, mayDrive) {
    if (operator) return "You drive";
    if (taken) return "You watch; somebody else drives";
    return mayDrive ? "Nobody drives" : "You watch";
}
