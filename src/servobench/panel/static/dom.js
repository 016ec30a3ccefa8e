// Elements by hand. Texts are always text, never markup, so nothing that somebody typed is ever run.

export const byId = (id) => document.getElementById(id);

// An element with attributes, listeners (`on: {click: f}`), properties (`set: {value: 1}`) and children; null children are left out.
export function el(tag, attributes = {}, ...children) {
    const made = document.createElement(tag);
    for (const [name, value] of Object.entries(attributes)) {
        if (name === "on") {
            for (const [event, listener] of Object.entries(value)) made.addEventListener(event, listener);
        } else if (name === "set") {
            Object.assign(made, value);
        } else if (value === true) {
            made.setAttribute(name, "");
        } else if (value !== false && value != null) {
            made.setAttribute(name, value);
        }
    }
    made.append(...children.flat().filter((child) => child != null));
    return made;
}

// An icon of the page's own sprite.
export function icon(name) {
    const space = "http://www.w3.org/2000/svg";
    const drawing = document.createElementNS(space, "svg");
    drawing.setAttribute("class", "icon");
    drawing.setAttribute("aria-hidden", "true");
    const use = document.createElementNS(space, "use");
    use.setAttribute("href", `#icon-${name}`);
    drawing.append(use);
    return drawing;
}

// The shape of a light or a verdict; which one it is follows from `data-level` of what holds it.
export const shape = () => el("span", { class: "shape", "aria-hidden": "true" });

// Put a text where another stands; leaves the page alone where it is the same, so that readers aren't told twice.
export function say(element, text) {
    if (element.textContent !== text) element.textContent = text;
}

// A text as part of an element's id.
export const slug = (text) => text.replace(/[^A-Za-z0-9_-]/g, "-");
