// What an exercise's studies find, where they stand in its text: asked for once, when somebody wants to see it.

// The page's colours for those that a figure is drawn in.
const COLOURS = { ink: "--ink", muted: "--quiet", rule: "--line", measured: "--edge", model: "--accent", band: "--accent-soft", shade: "--raised" };
const SHOW = "Show the results";
const FONT = "system-ui, sans-serif";

// The places of an exercise's studies and of its corrections, empty but for a button. `get(path)` resolves to the answer's JSON.
export function places(exercise, get) {
  const found = new Map();
  const corrections = html("section", { class: "exercises-corrections" });
  const status = html("p", { class: "exercises-told", role: "status" });
  const fill = async () => {
    const buttons = [...found.values()].flatMap((place) => [...place.querySelectorAll("button")]);
    const say = (text, busy) => {
      for (const button of buttons) Object.assign(button, { textContent: busy ? text : SHOW, disabled: busy });
      status.textContent = text;
    };
    say("The motor is being simulated…", true);
    try {
      const { studies, corrections: errs } = await get(`/api/exercises/${encodeURIComponent(exercise.name)}/results`);
      for (const [name, place] of found) place.replaceChildren(...shown(studies[name]));
      if (errs.length) corrections.replaceChildren(html("h3", {}, "Errors in the paper"), ...errs.map(correction));
      status.textContent = "";
    } catch (error) {
      say(`It can't be shown: ${error.message}`, false);
    }
  };
  const place = (name) => {
    const made = html("section", { class: "exercises-study", "aria-label": `What is found: ${name}` });
    const button = html("button", { class: "exercises-reveal", type: "button" }, SHOW);
    button.addEventListener("click", fill);
    made.append(button);
    found.set(name, made);
    return made;
  };
  return { place, status, corrections };
}

function shown({ tables, figures, sentences }) {
  return [
    ...tables.flatMap(table),
    ...figures.map(figure),
    ...sentences.map((sentence) => html("p", {}, sentence)),
  ];
}

function table({ title, note, columns }) {
  const head = html("tr");
  for (const { heading, kind } of columns) head.append(html("th", { scope: "col", class: kind }, heading));
  const body = html("tbody");
  for (let row = 0; row < (columns[0]?.texts.length ?? 0); row++) {
    const line = html("tr");
    columns.forEach(({ kind, texts }, n) => line.append(html(n ? "td" : "th", n ? { class: kind } : { scope: "row", class: kind }, texts[row])));
    body.append(line);
  }
  const made = html("table");
  const above = html("thead");
  above.append(head);
  made.append(above, body);
  const frame = html("div", { class: "exercises-scroll", role: "region", tabindex: "0", "aria-label": title || "Table" });
  frame.append(made);
  return [title && html("h4", {}, title), frame, note && html("p", { class: "exercises-note" }, note)].filter(Boolean);
}

function figure({ title, caption, description, svg }) {
  const made = html("figure");
  const image = html("img", { alt: `${title}. ${description}` });
  const said = html("figcaption");
  said.append(html("b", {}, `${title}. `), caption);
  const paint = () => (image.src = `data:image/svg+xml,${encodeURIComponent(coloured(svg))}`);
  const repaint = () => (image.isConnected ? paint() : document.removeEventListener("theme", repaint));
  document.addEventListener("theme", repaint);
  paint();
  made.append(image, said);
  return made;
}

// A drawing as a picture of its own, in the page's colours: a picture can't ask the page for them.
function coloured(svg) {
  const style = getComputedStyle(document.documentElement);
  const painted = svg.replace(/var\(--(\w+)\)/g, (_, name) => style.getPropertyValue(COLOURS[name] ?? "--ink").trim());
  return painted.replace("<svg ", `<svg xmlns="http://www.w3.org/2000/svg" font-family="${FONT}" `);
}

function correction({ where, paper, ours, why }) {
  const made = html("div", { class: "exercises-correction" });
  made.append(html("h4", {}, where));
  const sides = html("dl");
  sides.append(html("dt", {}, "The paper"), html("dd", {}, paper), html("dt", {}, "Here"), html("dd", { class: "ours" }, ours));
  made.append(sides, html("p", {}, why));
  return made;
}

function html(name, attributes = {}, content = "") {
  const element = document.createElement(name);
  for (const [key, value] of Object.entries(attributes)) element.setAttribute(key, value);
  element.textContent = content;
  return element;
}
