// Whether the page hears anything: what isn't heard isn't known, and what was known before is no longer told as if it were so now.

import { announce, toast } from "./announcer.js";
import { byId, say } from "./dom.js";

const STARTED_ANEW = "The panel was restarted and doesn't know this page: open the address printed in its terminal.";
const ENDED = "If the panel has ended, start it in a terminal, and open the address that it prints.";
const LONG = 5000; // ms without a connection, after which it may have ended
const OLD = 1000; // ms without rows; of slow loops three ticks

export function makeLink(store) {
    const strip = byId("link-told");
    let lostAt = null;
    let timer = 0;
    const seconds = () => Math.max(1, Math.round((performance.now() - lostAt) / 1000));
    const tell = () => {
        if (store.link === "unknown") return say(byId("link-text"), `${STARTED_ANEW} This page then goes on by itself, or is closed.`);
        const why = store.link === "silent" ? "No data from the panel" : "There has been no connection to the panel";
        const further = store.link === "lost" && lostAt < performance.now() - LONG ? ` ${ENDED}` : "";
        say(byId("link-text"), `${why} for ${seconds()} s: what the motor does isn't known here. ${andNow(store.state)}${further}`);
    };
    store.on("link", (status) => {
        if (status === "connected") {
            clearInterval(timer);
            strip.hidden = true;
            return;
        }
        if (lostAt === null) {
            lostAt = performance.now();
            announce(`No connection: what the motor does isn't known here. ${andNow(store.state)}`);
        }
        if (status === "unknown") announce(STARTED_ANEW);
        clearInterval(timer);
        timer = setInterval(tell, 1000);
        tell();
        strip.hidden = false;
    });
    store.on("state", (state) => {
        if (lostAt === null || state.unknown) return;
        const stands = state.running && !state.enabled ? ` The motor stands${state.stopped ? `: ${state.stopped}` : ""}.` : "";
        const sentence = `Connected again after ${seconds()} s.${stands}`;
        lostAt = null;
        toast(sentence);
        announce(sentence);
    });
}

// What happens without a word of this page.
function andNow(state) {
    if (state?.fault?.code === "switch-off") return `Last report: ${state.fault.sentence}.`;
    if (!state?.operator) return "Another page drives the motor.";
    return "If this page, which drives, loses its connection, the loop sets the voltage to zero within 2 s, unless its device doesn't respond: if the motor still turns after that, switch off the supply.";
}

// Readings whose rows are old are taken away.
export function makeFreshness(store, scopes) {
    setInterval(() => {
        const limit = Math.max(OLD, 3000 * (store.state?.sample_time ?? 0));
        const old = store.link !== "connected" || store.state?.running === false || performance.now() - scopes.taken > limit;
        scopes.setOld(old);
    }, 200);
}
