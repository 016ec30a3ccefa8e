// Exercises: what to do, what comes out, what to enter, and whether it is right.

import { places } from "./results.js";

// What an exercise's text may hold; anything else becomes its text.
const KEPT = new Set([
  "P", "H1", "H2", "H3", "H4", "H5", "H6", "UL", "OL", "LI", "STRONG", "EM", "CODE", "PRE", "BLOCKQUOTE", "HR", "BR", "A",
  "TABLE", "THEAD", "TBODY", "TR", "TH", "TD",
]);
const MATHML = "http://www.w3.org/1998/Math/MathML";
const FORMULA = new Set(["math", "mrow", "mi", "mn", "mo", "mtext", "mspace", "mfrac", "msup", "msub", "msubsup", "msqrt"]);
const SET = ["display", "alttext", "form", "lspace", "rspace", "width", "mathvariant"]; // how a formula is set
const PLACED = ["shown", "kept"]; // a formula by itself, and one with its comma
const CHECK = "Check the answers";
let mounted = 0;

// Shows the exercises in an element. `api` has `get(path)` and `post(path, body)`, which resolve to the answer's JSON and reject
// with a sentence, and `set(experiment)`, which puts {signal, controller, chain, duration, sample_time} before the operator.
export function mount(element, api) {
  const view = { element, api, number: ++mounted, answers: new Map() };
  element.classList.add("exercises");
  return { ready: list(view) };
}

async function list(view) {
  const found = await view.api.get("/api/exercises");
  const entries = html("ul", { class: "exercises-list" });
  for (const { name, title, sentence, error } of found) {
    const open = html("button", { class: "exercises-open", type: "button", "data-exercise": name });
    open.append(html("span", { class: "exercises-title" }, title), html("span", { class: "exercises-sentence" }, sentence));
    open.addEventListener("click", () => show(view, name));
    const entry = html("li");
    entry.append(error ? html("p", { class: "exercises-failed" }, `${title} can't be read: ${error}`) : open);
    entries.append(entry);
  }
  view.element.replaceChildren(html("h2", {}, "Exercises"), entries);
}

async function show(view, name) {
  const exercise = await view.api.get(`/api/exercises/${encodeURIComponent(name)}`);
  const back = html("button", { class: "exercises-back", type: "button" }, "All exercises");
  back.addEventListener("click", async () => {
    await list(view);
    view.element.querySelector(`[data-exercise="${CSS.escape(name)}"]`)?.focus();
  });
  const heading = html("h2", { tabindex: "-1" }, exercise.title);
  const load = html("button", { class: "exercises-load", type: "button" }, "Load this experiment");
  const told = html("p", { class: "exercises-told", role: "status" });
  load.addEventListener("click", () => loaded(view, exercise, told));
  const results = places(exercise, (path) => view.api.get(path));
  const text = html("div", { class: "exercises-text" });
  for (const piece of exercise.pieces) text.append(...(piece.study ? [results.place(piece.study)] : safe(piece.html)));
  view.element.replaceChildren(back, heading, load, told, text, results.status, form(view, exercise), results.corrections);
  heading.focus();
}

async function loaded(view, exercise, told) {
  try {
    const changed = await view.api.set(exercise.experiment);
    told.textContent = ["The experiment is loaded; start it when you are ready.", changed].filter(Boolean).join(" ");
  } catch (error) {
    told.textContent = `It can't be loaded: ${error.message}`;
  }
}

function form(view, exercise) {
  const questions = html("form", { class: "exercises-form", "aria-label": "Answers", autocomplete: "off" });
  const rows = new Map();
  for (const blank of exercise.blanks) {
    const id = `exercises-${view.number}-${exercise.name}-${blank.id}`;
    const row = html("div", { class: "exercises-blank" });
    const input = html("input", { id, type: "text", maxlength: 100, spellcheck: "false", "aria-describedby": `${id}-said` });
    input.value = view.answers.get(`${exercise.name}/${blank.id}`) ?? "";
    input.addEventListener("input", () => {
      view.answers.set(`${exercise.name}/${blank.id}`, input.value);
      row.removeAttribute("data-right");
      said.replaceChildren();
    });
    const said = html("p", { id: `${id}-said`, class: "exercises-said", role: "status" });
    const entry = html("span", { class: "exercises-entry" });
    entry.append(input, html("span", { class: "exercises-unit" }, blank.unit));
    row.append(html("label", { for: id }, blank.label), entry, said);
    rows.set(blank.id, { row, input, said });
    questions.append(row);
  }
  const check = html("button", { class: "exercises-check", type: "submit" }, CHECK);
  const failed = html("p", { class: "exercises-failed", role: "alert" });
  questions.append(check, failed);
  questions.addEventListener("submit", (event) => {
    event.preventDefault();
    checked(view, exercise, rows, check, failed);
  });
  return questions;
}

async function checked(view, exercise, rows, button, failed) {
  const given = [...rows].filter(([, { input }]) => input.value.trim()).map(([id, { input }]) => [id, input.value]);
  failed.textContent = given.length ? "" : "Enter an answer first.";
  if (!given.length) return;
  button.disabled = true;
  button.textContent = "Checking …"; // the motor is simulated for it
  try {
    const path = `/api/exercises/${encodeURIComponent(exercise.name)}/check`;
    const { answers } = await view.api.post(path, { answers: Object.fromEntries(given) });
    for (const [id, { right, sentence }] of Object.entries(answers)) {
      const { row, said } = rows.get(id);
      row.setAttribute("data-right", String(right));
      said.replaceChildren(html("span", { class: "exercises-mark", "aria-hidden": "true" }, right ? "✓" : "✗"), sentence);
    }
  } catch (error) {
    failed.textContent = `The answers can't be checked: ${error.message}`;
  } finally {
    button.disabled = false;
    button.textContent = CHECK;
  }
}

// The nodes of a text: the server makes it from Markdown, and here only plain text elements without attributes, and formulas, get
// through.
function safe(source) {
  const parsed = new DOMParser().parseFromString(source, "text/html");
  return [...parsed.body.childNodes].flatMap(kept);
}

function kept(node) {
  if (node.nodeType === Node.TEXT_NODE) return [document.createTextNode(node.data)];
  if (node.nodeType !== Node.ELEMENT_NODE) return [];
  const inner = [...node.childNodes].flatMap(kept);
  if (node.namespaceURI === MATHML) return FORMULA.has(node.localName) ? [formula(node, inner)] : inner;
  if (node.tagName === "SPAN" && PLACED.includes(node.className)) {
    const place = html("span", { class: node.className });
    place.append(...inner);
    return [place];
  }
  if (!KEPT.has(node.tagName)) return inner;
  const copy = document.createElement(node.tagName);
  const target = node.tagName === "A" ? node.getAttribute("href") ?? "" : "";
  if (/^https?:/i.test(target)) {
    copy.setAttribute("href", target);
    copy.setAttribute("target", "_blank");
    copy.setAttribute("rel", "noopener noreferrer");
  }
  copy.append(...inner);
  return [copy];
}

function formula(node, inner) {
  const copy = document.createElementNS(MATHML, node.localName);
  for (const name of SET) {
    if (node.hasAttribute(name)) copy.setAttribute(name, node.getAttribute(name));
  }
  copy.append(...inner);
  return copy;
}

function html(name, attributes = {}, content = "") {
  const element = document.createElement(name);
  for (const [key, value] of Object.entries(attributes)) element.setAttribute(key, value);
  element.textContent = content;
  return element;
}
