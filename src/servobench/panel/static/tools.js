// The row of tools above the scopes.

import { byId, el, icon } from "./dom.js";
import { seconds } from "./format.js";
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
        { id: "span", on: { change: () => scopes.setSpan(Number(span.value)) } },
        SPANS.map((each) => el("option", { value: each, selected: each === view.span }, seconds(each))),
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
    const angle = el(
        "select",
        { id: "angle", on: { change: () => ((scopes.angle = angle.value), scopes.setUnits()) } },
        Object.entries(ANGLES).map(([name, { title }]) => el("option", { value: name, selected: name === scopes.angle }, title)),
    );
    const save = el(
        "div",
        { class: "group", role: "group", "aria-label": "Save what is seen" },
        el("button", { type: "button", class: "tool wide", on: { click: () => scopes.saveTable() } }, icon("save"), "CSV"),
        el("button", { type: "button", class: "tool wide", on: { click: () => scopes.savePicture() } }, icon("save"), "PNG"),
    );
    const labelled = (text, field) => el("label", { class: "inline" }, el("span", {}, text), field);
    byId("tools").append(pause, labelled("Time", span), zoom, cursors, trigger, which, labelled("Angle", angle), save);

    const show = () => {
        pause.replaceChildren(icon(view.paused ? "play" : "pause"), view.paused ? "Run" : "Pause");
        pause.classList.toggle("on", view.paused);
        cursors.setAttribute("aria-pressed", String(view.cursors !== null));
        trigger.setAttribute("aria-pressed", String(view.trigger.on));
    };
    show();
    return show;
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
