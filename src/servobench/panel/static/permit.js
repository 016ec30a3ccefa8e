// Why something can't be done now: what can't be pressed says so, in its title and by what describes it.

import { byId, say } from "./dom.js";

// The reason why nothing can be set now, or "" where it can.
export function whyNot(state) {
    if (!state) return "The panel isn't connected yet.";
    if (state.unknown) return "There is no connection to the panel.";
    if (state.opening) return "The device is being opened.";
    if (!state.operator) return state.taken ? "Somebody else drives; you can watch and STOP." : "Take control first.";
    return "";
}

// Switch a control off for a reason, or on where there is none.
export function permit(control, reason) {
    control.disabled = Boolean(reason);
    control.title = reason;
}

// The strip that tells what is being opened, how far that is, and for how long it has gone on.
export function makeOpening(store) {
    const strip = byId("opening");
    let since = null;
    let timer = 0;
    const tell = () => {
        const { opening } = store.state;
        const seconds = Math.floor((performance.now() - since) / 1000);
        say(byId("opening-time"), `step ${opening.step} of ${opening.of}  ·  ${seconds} s`);
    };
    store.on("state", ({ opening, unknown = false }) => {
        strip.hidden = !opening || unknown;
        clearInterval(timer);
        if (strip.hidden) return;
        since = performance.now() - 1000 * opening.seconds;
        say(byId("opening-title"), `Opening ${store.titleOf(opening.device)}`);
        say(byId("opening-text"), `${opening.doing}. The first time this may take minutes, as the motor's equations are compiled; then seconds. All controls wait for it.`);
        byId("opening-bar").value = opening.step - 0.5;
        byId("opening-bar").max = opening.of;
        tell();
        timer = setInterval(tell, 1000);
    });
}
