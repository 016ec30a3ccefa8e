// A kind's member and its settings as a form: which one, its fields, and what was last known to hold.

import { el } from "./dom.js";
import { makeField } from "./fields.js";
import { makeParts } from "./parts.js";

const AT_ONCE = 4; // fields that are seen at once; the rest is one step away
const DEEPEST = 2; // forms within forms: where signals are made of signals that are made of signals, the column is too narrow for more

export class SettingsForm {
    constructor({ prefix, label, members, onEdit, depth = 0 }) {
        Object.assign(this, { prefix, members, onEdit, depth });
        this.choice = el("select", { id: `${prefix}-type` }, members.map((each) => el("option", { value: each.name }, each.title)));
        this.sentence = el("p", { class: "hint", id: `${prefix}-sentence` });
        this.choice.setAttribute("aria-describedby", this.sentence.id);
        this.fields = [];
        this.filled = new Map(); // kind -> its fields with what was typed, while the form lives
        this.unitOf = (unit) => unit;
        this.body = el("div", { class: "fields" });
        const top = el("div", { class: "field type" }, el("label", { for: `${prefix}-type`, class: "hide" }, label), this.choice);
        top.append(this.sentence);
        this.element = el("div", { class: "settings" }, top, this.body);
        this.choice.addEventListener("change", () => {
            this.build();
            this.onEdit();
        });
        this.body.addEventListener("input", () => this.onEdit());
        this.build();
    }

    get member() {
        return this.members.find((each) => each.name === this.choice.value) ?? this.members[0];
    }

    build() {
        this.sentence.textContent = this.member.sentence;
        const { name, fields } = this.member;
        if (!this.filled.has(name)) this.filled.set(name, fields.map((field) => this.fieldFor(field)));
        this.fields = this.filled.get(name);
        this.measure(this.unitOf);
        const elements = this.fields.map((field) => field.element);
        const more = elements.slice(AT_ONCE);
        this.body.replaceChildren(...elements.slice(0, AT_ONCE));
        if (more.length) this.body.append(el("details", {}, el("summary", {}, "More settings"), more));
    }

    // A field of the form; signals within a signal are forms in their turn, and a text from a depth on.
    fieldFor(field) {
        if (!field.parts) return makeField(this.prefix, field);
        if (this.depth >= DEEPEST) return makeField(this.prefix, { ...field, sentence: `${field.sentence} So deep within others they are written as a file has them.` });
        const within = (prefix) => new SettingsForm({ prefix, label: "Kind", members: this.members, onEdit: () => this.onEdit(), depth: this.depth + 1 });
        return makeParts(this.prefix, field, within, () => this.onEdit());
    }

    // Tell the fields' units as `unitOf` says.
    measure(unitOf) {
        this.unitOf = unitOf;
        for (const field of this.fields) field.measure(unitOf);
    }

    // {type, settings...}; throws what is wrong with a field's text.
    value() {
        const made = { type: this.choice.value };
        for (const field of this.fields) {
            const value = field.read();
            if (value !== undefined) made[field.name] = value;
        }
        return made;
    }

    // Those that aren't as they would be without a word.
    changed() {
        const value = this.value();
        const defaults = Object.fromEntries(this.member.fields.map((field) => [field.name, field.default]));
        const same = (name) => name in defaults && JSON.stringify(defaults[name]) === JSON.stringify(value[name]);
        return Object.fromEntries(Object.entries(value).filter(([name]) => !same(name)));
    }

    show(value) {
        if (!this.members.some((each) => each.name === value.type)) return;
        this.choice.value = value.type;
        this.filled.delete(value.type); // what isn't said is as it is without a word
        this.build();
        for (const field of this.fields) if (field.name in value) field.write(value[field.name]);
    }
}

// A form whose content is one thing that the loop has: edited here, sent on Enter or by the button, and followed while untouched.
export class AppliedForm {
    constructor({ form, chip, settings, send, title }) {
        Object.assign(this, { form, chip, settings, known: null, edited: false });
        this.trouble = el("p", { class: "trouble", role: "alert" });
        this.button = el("button", { type: "submit", class: "apply" }, title);
        this.back = el("button", { type: "button", class: "plain", hidden: true, on: { click: () => this.revert() } }, "Back");
        this.set = el("fieldset", {}, settings.element, this.trouble, el("div", { class: "row" }, this.button, this.back));
        form.append(this.set);
        form.addEventListener("submit", (event) => {
            event.preventDefault();
            send();
        });
    }

    touch() {
        this.mark(true);
    }

    mark(edited) {
        this.edited = edited;
        this.form.classList.toggle("edited", edited);
        this.back.hidden = !edited || this.known === null;
    }

    sent(value, outcome) {
        if (!outcome.accepted) return;
        this.mark(false);
        this.known = JSON.stringify(value);
    }

    // What the loop has; shown unless a person is at work on it.
    follow(value) {
        const text = JSON.stringify(value);
        if (text === this.known) return false;
        this.known = text;
        if (this.edited) return false;
        this.settings.show(value);
        return true;
    }

    revert() {
        if (this.known === null) return;
        this.mark(false);
        this.trouble.textContent = "";
        this.settings.show(JSON.parse(this.known));
        this.onRevert?.();
    }
}
