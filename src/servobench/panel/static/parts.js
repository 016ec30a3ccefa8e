// Signals within a signal: its parts in their order, each with a kind and fields of its own; added, moved and removed by buttons.

import { announce } from "./announcer.js";
import { el, icon, say, slug } from "./dom.js";
import { makeField } from "./fields.js";
import { meaning, words } from "./format.js";

let made = 0; // parts so far: each has ids of its own, wherever it is moved

// A field as `makeField` makes them; `formOf(prefix)` makes the form of a part's signal, and `onEdit` is called when parts change.
export function makeParts(prefix, field, formOf, onEdit) {
    const { each } = field.parts;
    const id = `${prefix}-${slug(field.name)}`;
    const list = el("ol", { class: "parts" });
    const add = el("button", { type: "button", class: "plain", id: `${id}-add` }, icon("plus"), `Add a ${each}`);
    const element = el("div", { class: "field parted", role: "group", "aria-label": words(field.name) }, el("p", { class: "quiet" }, meaning(field.sentence)), list, add);
    let parts = [];
    let unitOf = (unit) => unit;

    // The numbers of all, as they stand now, and what can be done with each.
    const number = () => {
        list.replaceChildren(...parts.map((part) => part.element));
        parts.forEach((part, k) => part.place(k, parts.length));
    };
    const changed = (sentence) => {
        number();
        announce(sentence);
        onEdit();
    };
    const insert = (value, at) => {
        const part = makePart(`${id}-${(made += 1)}`, field.parts, formOf, { move, remove });
        part.write(value);
        part.measure(unitOf);
        parts.splice(at, 0, part);
        return part;
    };
    const move = (part, by) => {
        const from = parts.indexOf(part);
        const to = from + by;
        if (to < 0 || to >= parts.length) return;
        parts.splice(to, 0, ...parts.splice(from, 1));
        changed(`${words(each)} ${from + 1} is ${each} ${to + 1} of ${parts.length} now`);
        part.focus(by < 0 ? "up" : "down");
    };
    const remove = (part) => {
        if (parts.length === 1) return;
        const at = parts.indexOf(part);
        parts.splice(at, 1);
        changed(`${words(each)} ${at + 1} is removed, ${parts.length} left`);
        parts[Math.min(at, parts.length - 1)].focus("remove");
    };
    add.addEventListener("click", () => {
        const part = insert(field.default[0], parts.length);
        changed(`${words(each)} ${parts.length} is added`);
        part.focus("kind");
    });
    const write = (values) => {
        parts = [];
        for (const value of values ?? []) insert(value, parts.length);
        number();
    };
    const measure = (named) => {
        unitOf = named;
        for (const part of parts) part.measure(named);
    };
    write(field.default);
    return { name: field.name, element, measure, read: () => parts.map((part) => part.read()), write };
}

// One part: its number and buttons, fields of its own, and its signal's form.
function makePart(id, { each, signal, fields }, formOf, { move, remove }) {
    const form = formOf(id);
    const own = fields.map((field) => makeField(id, field));
    const title = el("span", { class: "nth", "aria-hidden": "true" });
    const button = (drawn, run) => el("button", { type: "button", class: "plain square", on: { click: () => run(part) } }, icon(drawn));
    const buttons = { up: button("up", () => move(part, -1)), down: button("down", () => move(part, 1)), remove: button("bin", () => remove(part)) };
    const group = el(
        "div",
        { class: "part", role: "group" },
        el("div", { class: "row between" }, title, el("span", { class: "row" }, Object.values(buttons))),
        own.length ? el("div", { class: "fields" }, own.map((field) => field.element)) : null,
        form.element,
    );
    const labels = { up: (name) => `Move ${name} up`, down: (name) => `Move ${name} down`, remove: (name) => `Remove ${name}` };
    let name = each;
    const part = {
        element: el("li", {}, group),
        // Which one it is of how many; what can't be done with it stays where it is, so that the focus does.
        place: (k, of) => {
            name = `${each} ${k + 1}`;
            say(title, words(name));
            group.setAttribute("aria-label", `${words(name)} of ${of}`);
            const impossible = { up: k === 0, down: k === of - 1, remove: of === 1 };
            for (const [what, made] of Object.entries(buttons)) {
                made.setAttribute("aria-label", labels[what](name));
                made.setAttribute("aria-disabled", String(impossible[what]));
            }
            buttons.remove.title = of === 1 ? `There has to be one ${each} at least.` : "";
        },
        focus: (what) => (what === "kind" ? form.choice : buttons[what]).focus(),
        measure: (unitOf) => {
            for (const field of own) field.measure(unitOf);
            form.measure(unitOf);
        },
        read: () => {
            try {
                const value = Object.fromEntries(own.map((field) => [field.name, field.read()]));
                return signal ? { ...value, [signal]: form.value() } : form.value();
            } catch (error) {
                throw new Error(`${words(name)}: ${error.message}`, { cause: error });
            }
        },
        write: (value) => {
            for (const field of own) if (field.name in value) field.write(value[field.name]);
            form.show(signal ? value[signal] : value);
        },
    };
    return part;
}
