// STOP: the button and Esc, from anywhere on the page, by the socket and by a request, so that either one is enough.

import { post } from "./api.js";
import { announce, toast } from "./announcer.js";
import { byId } from "./dom.js";

export function makeStop(socket) {
    const stop = async () => {
        const sent = socket.send({ do: "stop" });
        byId("stop").classList.add("pressed");
        setTimeout(() => byId("stop").classList.remove("pressed"), 400);
        try {
            await post("/api/stop");
        } catch (error) {
            if (!sent) {
                toast(`STOP couldn't be sent: ${error.message}. The loop stops the motor by itself when the page is gone.`);
                announce("STOP couldn't be sent");
            }
        }
    };
    byId("stop").addEventListener("click", stop);
    // Before anything else that Esc might mean.
    window.addEventListener("keydown", (event) => event.key === "Escape" && !event.repeat && stop(), { capture: true });
    return stop;
}
