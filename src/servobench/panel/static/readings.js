// The newest readings as text, for who can't see the scopes; spoken every few seconds where that was asked for.

import { announce } from "./announcer.js";
import { byId, el, icon, say } from "./dom.js";
import { fixed } from "./format.js";

const SPOKEN_EVERY = 5000; // ms

export function makeReadings(scopes) {
    const list = byId("readings");
    const names = { "aria-label": "Speak readings", title: "Speak readings to a screen reader" };
    const speak = el("button", { type: "button", class: "tool", id: "speak", "aria-pressed": "false", ...names }, icon("speak"));
    byId("keep").append(speak);
    let timer = 0;
    const places = new Map();
    const current = () =>
        scopes.visible().flatMap((scope) =>
            scope.visible().map((trace) => {
                const y = scopes.newest()[trace.column];
                const value = y.length ? trace.factor * y[y.length - 1] : NaN;
                const name = scope.definition.title === trace.title ? trace.title : `${scope.definition.title}, ${trace.title.toLowerCase()}`;
                return { name, text: Number.isFinite(value) ? `${fixed(value, scope.digits(trace))} ${trace.unit}` : scopes.old ? "not known now" : "not measured" };
            }),
        );
    speak.addEventListener("click", () => {
        const on = speak.getAttribute("aria-pressed") !== "true";
        speak.setAttribute("aria-pressed", String(on));
        clearInterval(timer);
        const tell = () => announce(current().map(({ name, text }) => `${name} ${text}`).join("; "));
        if (on) {
            tell();
            timer = setInterval(tell, SPOKEN_EVERY);
        }
    });
    return () => {
        const now = current();
        const names = now.map(({ name }) => name).join();
        if (list.dataset.names !== names) {
            list.dataset.names = names;
            places.clear();
            list.replaceChildren(...now.flatMap(({ name }) => {
                places.set(name, el("dd"));
                return [el("dt", {}, name), places.get(name)];
            }));
        }
        for (const { name, text } of now) say(places.get(name), text);
    };
}
