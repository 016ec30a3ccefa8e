// The row of tools above the scopes.

import { byId, el, icon } from "./dom.js";
import { ANGLES } from "./traces.js";
import { SPANS } from "./view.js";

const button = (name, title, run, extra = {}) =>
    el("button", { type: "button", class: "tool", "aria-label": title, title, on: { click: run }, ...extra }, icon(name));

export function makeTools(scopes) {
    const view = scopes.view;
    const pause = el("button", { type: "button", class: "tool wide", id: "pause", on: { click: () => toggle() } });
    const toggle = () => scopes.act(() => (view.paused ? view.resume() : view.pause()));

    const span = el(
        "select",
        { id: "span", "aria-label": "Time shown", title: "Time shown", on: { change: () => scopes.setSpan(Number(span.value)) } },
        SPANS.map((each) => el("option", { value: each, selected: each === view.span }, each < 1 ? `${1000 * each} ms` : `${each} s`)),
    );
    const zoom = el(
        "div",
        { class: "group", role: "group", "aria-label": "Zoom" },
        button("plus", "Zoom in", () => scopes.act(() => view.scale(0.5))),
        button("minus", "Zoom out", () => scopes.act(() => view.scale(2))),
        button("left", "Earlier", () => scopes.act(() => view.move(-0.25))),
        button("right", "Later", () => scopes.act(() => view.move(0.25))),
        button("fit", "All that is kept", () => scopes.act(() => view.zoom(null))),
    );
    const cursors = button("cursors", "Cursors", () => scopes.act(() => (view.cursors = view.cursors ? null : [0.35, 0.65])), {
        id: "cursors",
        "aria-pressed": "false",
    });
    const trigger = button("trigger", "Trigger", () => scopes.act(() => switchTrigger(view)), { id: "trigger", "aria-pressed": "false" });
    const which = el(
        "div",
        { class: "group which", role: "group", "aria-label": "Scopes shown" },
        scopes.scopes.map((scope) => shownSwitch(scopes, scope)),
    );
    const keep = (text, run) => {
        const label = `Save what is seen as ${text}`;
        return el("button", { type: "button", class: "tool wide", "aria-label": label, on: { click: run } }, icon("save"), text);
    };
    byId("keep").append(keep("CSV", () => scopes.saveTable()), keep("PNG", () => scopes.savePicture()));
    byId("tools").append(pause, span, zoom, el("div", { class: "group" }, cursors, trigger), which);
    scopes.scopes.find((scope) => scope.definition.id === "position").unitText.replaceWith(angleChoice(scopes));

    const show = () => {
        pause.replaceChildren(icon(view.paused ? "play" : "pause"), view.paused ? "Run" : "Pause");
        pause.classList.toggle("on", view.paused);
        cursors.setAttribute("aria-pressed", String(view.cursors !== null));
        trigger.setAttribute("aria-pressed", String(view.trigger.on));
    };
    show();
    return show;
}

// The unit of angles, where the position's unit stands.
function angleChoice(scopes) {
    const made = el(
        "select",
        { id: "angle", class: "unit", "aria-label": "Unit of angles", on: { change: () => ((scopes.angle = made.value), scopes.setUnits()) } },
        Object.entries(ANGLES).map(([name, { title }]) => el("option", { value: name, selected: name === scopes.angle }, title)),
    );
    return made;
}

function switchTrigger(view) {
    view.trigger.on = !view.trigger.on;
    view.swept = null;
    view.armed = true;
}

function shownSwitch(scopes, scope) {
    const made = el(
        "button",
        {
            type: "button",
            class: "tool wide",
            "aria-pressed": String(scope.shown),
            on: {
                click: () => {
                    if (scope.shown && scopes.visible().length === 1) return; // something has to be seen
                    scope.shown = !scope.shown;
                    made.setAttribute("aria-pressed", String(scope.shown));
                    scopes.layOut();
                },
            },
        },
        scope.definition.title,
    );
    return made;
}
