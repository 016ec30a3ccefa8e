// Form fields made from the catalogue: each setting with its label, unit, limits and meaning.

import { el, say, slug } from "./dom.js";
import { meaning, words } from "./format.js";

// A value as a number, whether it came as one or as a text with its unit.
const plain = (value) => (typeof value === "number" ? value : parseFloat(value));


// {element, read, write}; `read` gives undefined for a field that was left empty, and throws what is wrong with a text.
export function makeField(prefix, field) {
    const id = `${prefix}-${slug(field.name)}`;
    const made = kindOf(field)(id, field);
    made.input.id = id;
    const hint = el("p", { class: "hint", id: `${id}-hint` }, meaning(field.sentence));
    if (hint.textContent) made.input.setAttribute("aria-describedby", hint.id);
    const unit = field.unit ? el("span", { class: "unit", "aria-hidden": "true" }) : null;
    const spoken = el("span", { class: "hide" });
    const label = el("label", { for: id }, words(field.name), field.unit ? spoken : null);
    // A signal is in the unit of what follows it, which another controller changes.
    const measure = (unitOf) => {
        if (!unit) return;
        say(unit, unitOf(field.unit));
        say(spoken, ` in ${unitOf(field.unit)}`);
    };
    measure((name) => name);
    const element = el("div", { class: "field" }, label, el("span", { class: "entry" }, made.input, unit), hint);
    made.write(field.default);
    return { name: field.name, element, measure, read: made.read, write: made.write };
}

// By the type that the setting's own model says.
function kindOf(field) {
    if (field.choices?.length) return choice;
    return { number, text, "number or text": either, truth, numbers: list, table: tables }[field.type];
}

function choice(_, field) {
    const none = field.default === null ? [el("option", { value: "" }, field.unset ?? "not set")] : [];
    const input = el("select", {}, none, field.choices.map((each) => el("option", { value: String(each) }, words(String(each)))));
    return {
        input,
        read: () => field.choices.find((each) => String(each) === input.value),
        write: (value) => (input.value = String(value ?? (none.length ? "" : field.choices[0]))),
    };
}

function truth() {
    const input = el("input", { type: "checkbox" });
    return { input, read: () => input.checked, write: (value) => (input.checked = Boolean(value)) };
}

function number(_, field) {
    const input = el("input", { type: "number", step: "any", min: field.minimum, max: field.maximum, placeholder: field.unset ?? "not set", inputmode: "decimal" });
    const read = () => {
        if (input.validity.badInput) throw new Error(`${words(field.name)}: not a number`);
        if (input.value === "" && field.default != null) throw new Error(`${words(field.name)}: nothing is filled in; ${plain(field.default)}, for instance, is a number`);
        if (input.value === "" && field.required) throw new Error(`${words(field.name)}: nothing is filled in; it has to be a number`);
        return input.value === "" ? undefined : Number(input.value);
    };
    return { input, read, write: (value) => (input.value = value == null ? "" : String(plain(value))) };
}

function text(_, field) {
    const input = el("input", { type: "text", autocomplete: "off", spellcheck: "false", placeholder: field.unset ?? (field.required ? "" : "not set") });
    const read = () => {
        if (input.value === "" && field.required) throw new Error(`${words(field.name)}: nothing is filled in`);
        return input.value === "" ? undefined : input.value;
    };
    return { input, read, write: (value) => (input.value = value ?? "") };
}

// What can be told by its number or by its name.
function either(id, field) {
    const made = text(id, field);
    const read = () => {
        const value = made.read();
        return /^\d+$/.test(value ?? "") ? Number(value) : value;
    };
    return { ...made, read };
}

function list(_, field) {
    const input = el("input", { type: "text", autocomplete: "off", spellcheck: "false" });
    const read = () =>
        input.value.split(/[,;\s]+/).filter(Boolean).map((each) => {
            if (!Number.isFinite(Number(each))) throw new Error(`${words(field.name)}: “${each}” is no number; separate them by commas`);
            return Number(each);
        });
    return { input, read, write: (values) => (input.value = (values ?? []).map(plain).join(", ")) };
}

// Where a text isn't as it has to be, as far as the browser tells.
function unread(text, { message }) {
    if (!text.trim()) return "nothing is filled in. Back brings the last one that was applied";
    const at = Number(/position (\d+)/.exec(message)?.[1] ?? text.length);
    const before = text.slice(0, at).trimEnd();
    const near = before.split("\n").at(-1).trim().slice(-24);
    const line = before.split("\n").length;
    return `a comma, a quotation mark or a bracket is missing, or one too many, in line ${line}, ${near ? `after “${near}”` : "at its beginning"}. Back brings the last one that was applied`;
}

// Signals within a signal: as the text that a file would have.
function tables(_, field) {
    const input = el("textarea", { rows: 5, spellcheck: "false" });
    const read = () => {
        try {
            return JSON.parse(input.value);
        } catch (error) {
            throw new Error(`${words(field.name)}: ${unread(input.value, error)}`, { cause: error });
        }
    };
    return { input, read, write: (value) => (input.value = JSON.stringify(value, null, 1)) };
}
