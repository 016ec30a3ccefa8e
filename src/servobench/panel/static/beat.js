// The sign that this page lives and shows the motor as it is: its own drawing sends it, with how far it has drawn. A browser answers
// pings for a page that hangs, is frozen or is hidden; this it can't say for it. The motor turns only while it comes.

import { toast } from "./announcer.js";

const INTERVAL = 100; // ms between two; the server waits for 700

export function makeBeat(store, scopes, socket) {
    let sent = -Infinity;
    let drove = false; // as the page was hidden
    scopes.onFrame = (row) => {
        const now = performance.now();
        if (!store.state?.operator || now - sent < INTERVAL) return;
        sent = now;
        socket.send({ do: "beat", row });
    };
    // A hidden page draws nothing, and nobody watches: that is said at once.
    document.addEventListener("visibilitychange", () => {
        const { operator, enabled, stopped } = store.state ?? {};
        if (document.hidden) {
            drove = Boolean(operator && enabled);
            if (operator) socket.send({ do: "hidden" });
        } else if (drove && stopped) toast(`${stopped[0].toUpperCase()}${stopped.slice(1)}.`);
    });
}
