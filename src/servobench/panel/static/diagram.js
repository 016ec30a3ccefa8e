// The chain as a block diagram: drawn from GET /api/diagram; a click or Enter on a block shows its settings.

const SVG = "http://www.w3.org/2000/svg";
// The kinds whose titles don't tell what they are.
const CAPTIONED = new Set(["signal", "controller", "limits", "stage", "scope", "identification"]);
let drawings = 0;

// Draws the diagram into an element. `api` has `get(path)`, which resolves to the answer's JSON.
// Returns { refresh }: what to call when the loop has acknowledged something new.
export function mount(element, api) {
  const view = { element, shown: null };
  element.classList.add("diagram");
  const refresh = async () => show(view, await api.get("/api/diagram"));
  return { refresh, ready: refresh() };
}

function show(view, diagram) {
  const number = ++drawings;
  const details = html("div", { class: "diagram-details", id: `diagram-details-${number}`, "aria-live": "polite" });
  const blocks = new Map();
  const choose = (block) => {
    view.shown = block.id;
    for (const [id, group] of blocks) group.setAttribute("aria-pressed", String(id === block.id));
    details.replaceChildren(...settingsOf(block));
  };
  const picture = draw(diagram, number, blocks, choose, details.id);
  const scroll = html("div", { class: "diagram-scroll", role: "region", "aria-label": "Block diagram", tabindex: "0" });
  scroll.append(picture);
  const focused = view.element.contains(document.activeElement) ? document.activeElement.dataset.block : undefined;
  view.element.replaceChildren(scroll, details);
  const shown = diagram.blocks.find((block) => block.id === view.shown);
  if (shown) choose(shown);
  else details.replaceChildren(html("p", { class: "diagram-hint" }, "Choose a block to see its settings."));
  if (focused) blocks.get(focused)?.focus();
}

function draw(diagram, number, blocks, choose, details) {
  const picture = svg("svg", {
    class: "diagram-picture",
    viewBox: `0 0 ${diagram.width} ${diagram.height}`,
    width: diagram.width,
    height: diagram.height,
    role: "group",
    "aria-label": "Block diagram of the experiment",
  });
  const arrow = `diagram-arrow-${number}`;
  const marker = svg("marker", {
    id: arrow, viewBox: "0 0 10 10", refX: 9, refY: 5, markerWidth: 8, markerHeight: 8, orient: "auto", markerUnits: "userSpaceOnUse",
  });
  marker.append(svg("path", { class: "diagram-arrow", d: "M0 1 L10 5 L0 9 z" }));
  const definitions = svg("defs");
  definitions.append(marker);
  const { device } = diagram;
  const frame = svg("rect", { class: "diagram-frame", x: device.x, y: device.y, width: device.width, height: device.height, rx: 8 });
  const name = text(device.x + 16, device.y + 18, "diagram-frame-title", `device: ${device.title}`);
  const wires = svg("g", { class: "diagram-wires", "aria-hidden": "true" });
  for (const wire of diagram.wires) wires.append(...drawWire(wire, arrow));
  picture.append(definitions, frame, name, wires);
  for (const block of diagram.blocks) {
    const group = drawBlock(block, details);
    group.addEventListener("click", () => choose(block));
    group.addEventListener("keydown", (event) => {
      if (event.key !== "Enter" && event.key !== " ") return;
      event.preventDefault();
      choose(block);
    });
    blocks.set(block.id, group);
    picture.append(group);
  }
  return picture;
}

function drawWire(wire, arrow) {
  const points = wire.points.map(([x, y]) => `${x},${y}`).join(" ");
  const parts = [svg("polyline", { class: "diagram-wire", points, "marker-end": `url(#${arrow})` })];
  if (wire.joint) parts.push(svg("circle", { class: "diagram-joint", cx: wire.points[0][0], cy: wire.points[0][1], r: 3 }));
  if (wire.label) parts.push(text(wire.at[0], wire.at[1], "diagram-label", wire.label));
  return parts;
}

function drawBlock(block, details) {
  const summary = block.settings.filter(isSet).slice(0, 3).map((setting) => `${setting.name} ${shownValue(setting)}`).join(", ");
  const group = svg("g", {
    class: `diagram-block diagram-${block.kind}`,
    role: "button",
    tabindex: 0,
    "aria-pressed": "false",
    "aria-controls": details,
    "aria-label": [CAPTIONED.has(block.kind) ? `${block.kind}: ${block.title}` : block.title, summary].filter(Boolean).join("; "),
    "data-block": block.id,
  });
  const middle = block.x + block.width / 2;
  group.append(
    text(middle, block.y - 7, "diagram-kind", CAPTIONED.has(block.kind) ? block.kind : ""),
    svg("rect", { class: "diagram-box", x: block.x, y: block.y, width: block.width, height: block.height, rx: 3 }),
  );
  const bare = !block.symbol.length && !block.curve.length;
  group.append(text(middle, block.y + (bare ? block.height / 2 + 5 : 20), "diagram-title", block.title));
  group.append(...drawSymbol(block, middle), ...drawCurve(block));
  return group;
}

function drawSymbol(block, middle) {
  const [above, below] = block.symbol;
  if (above === undefined) return [];
  if (below === undefined) return [formula(middle, block.y + 52, above)];
  const letters = Math.max(plainText(above).length, plainText(below).length);
  const half = Math.min(block.width / 2 - 8, 4 * letters + 6);
  const bar = svg("line", { class: "diagram-bar", x1: middle - half, x2: middle + half, y1: block.y + 47, y2: block.y + 47 });
  return [formula(middle, block.y + 41, above), bar, formula(middle, block.y + 64, below)];
}

// A formula as text: what stands in ^{} is raised, what stands in _{} lowered.
function formula(x, y, source) {
  const element = text(x, y, "diagram-symbol", "");
  let shift = 0;
  for (const [, raised, lowered, level] of source.matchAll(/\^\{([^}]*)\}|_\{([^}]*)\}|([^_^]+|[_^])/g)) {
    const wanted = raised !== undefined ? -6 : lowered !== undefined ? 4 : 0;
    const part = svg("tspan", wanted ? { class: "diagram-small", dy: wanted - shift } : { dy: -shift });
    part.textContent = raised ?? lowered ?? level;
    element.append(part);
    shift = wanted;
  }
  return element;
}

function plainText(source) {
  return source.replace(/[_^]\{([^}]*)\}/g, "$1");
}

function drawCurve(block) {
  if (!block.curve.length) return [];
  const left = block.x + 18, top = block.y + 31, width = block.width - 36, height = block.height - 43;
  const points = block.curve.map(([x, y]) => `${left + x * width},${top + (1 - y) * height}`).join(" ");
  return [svg("polyline", { class: "diagram-curve", points })];
}

function settingsOf(block) {
  const heading = html("h3", { class: "diagram-heading" }, CAPTIONED.has(block.kind) ? `${block.title} (${block.kind})` : block.title);
  if (!block.settings.length) return [heading, html("p", { class: "diagram-hint" }, "It has no settings.")];
  const list = html("dl", { class: "diagram-settings" });
  for (const setting of block.settings) {
    const row = html("div", { class: isSet(setting) ? "diagram-setting" : "diagram-setting diagram-unset" });
    row.append(html("dt", {}, setting.name.replaceAll("_", " ")), html("dd", {}, shownValue(setting)));
    if (setting.sentence) row.append(html("dd", { class: "diagram-meaning" }, setting.sentence));
    list.append(row);
  }
  return [heading, list];
}

function isSet(setting) {
  return setting.value !== null && setting.value !== "";
}

function shownValue({ value, unit }) {
  if (value === null || value === "") return "not set";
  if (typeof value === "boolean") return value ? "yes" : "no";
  if (typeof value !== "number") return unit ? `${value} ${unit}` : value;
  const number = String(Number(value.toPrecision(6))).replace("-", "−");
  return unit ? `${number}\u00a0${unit}` : number;
}

function text(x, y, name, content) {
  const element = svg("text", { class: name, x, y });
  element.textContent = content;
  return element;
}

function svg(name, attributes = {}) {
  const element = document.createElementNS(SVG, name);
  for (const [key, value] of Object.entries(attributes)) element.setAttribute(key, value);
  return element;
}

function html(name, attributes = {}, content = "") {
  const element = document.createElement(name);
  for (const [key, value] of Object.entries(attributes)) element.setAttribute(key, value);
  element.textContent = content;
  return element;
}
