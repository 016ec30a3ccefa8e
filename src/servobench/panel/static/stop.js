// STOP: the buttons and Esc, from anywhere on the page, by the socket and by a request, so that either one is enough. It has
// happened when the loop says so; until then, and where it doesn't, the page says that.

import { post } from "./api.js";
import { announce, toast } from "./announcer.js";
import { byId, say } from "./dom.js";

const PATIENCE = 1000; // ms for the loop's acknowledgement, which takes a tick and a frame

export function makeStop(store, commands) {
    const place = byId("stop-told");
    const tell = (sentence) => {
        say(byId("stop-text"), sentence);
        place.hidden = !sentence;
    };
    const stop = async () => {
        for (const dialog of document.querySelectorAll("dialog[open]")) dialog.close(); // what becomes of it is told below
        byId("stop").classList.add("pressed");
        setTimeout(() => byId("stop").classList.remove("pressed"), 400);
        // Whether it worked is told by the loop, whichever way it went.
        let refused = "";
        post("/api/stop").catch((error) => (refused = ` (${error.message})`));
        const outcome = await commands.ask({ do: "stop" }, PATIENCE);
        if (outcome.accepted) return tell("");
        tell(`STOP was pressed, but the loop hasn't said that it stopped the motor${refused}. If the motor turns, cut its power.`);
        announce("STOP is not acknowledged. If the motor turns, cut its power.");
    };
    document.addEventListener("click", ({ target }) => target.closest?.("[data-stop]") && stop(), { capture: true });
    // Before anything else that Esc might mean.
    window.addEventListener("keydown", (event) => event.key === "Escape" && !event.repeat && stop(), { capture: true });
    byId("stop-close").addEventListener("click", () => tell(""));
    store.on("applied", ({ accepted, what }) => {
        if (place.hidden || !accepted || what?.enabled !== false) return;
        tell("");
        toast("STOP was acknowledged by the loop: zero volts are put out.");
    });
}
