// The recordings: found, annotated, compared, identified, taken away, deleted and brought back.

import { get, largestUpload, post, upload } from "./api.js";
import { complain, toast } from "./announcer.js";
import { columnsForm } from "./columns.js";
import { byId, el, icon, shape, slug } from "./dom.js";
import { plainly, readable, significant, words } from "./format.js";
import { makeProgress, megabytes, uploadProgress, workProgress } from "./progress.js";

const DELETED = "/deleted"; // no recording's name has a slash

export function makeRecordings(store, compare, showSelf) {
    const list = byId("recordings");
    const search = byId("search");
    const open = new Set(); // names whose details are open
    const results = new Map(); // name -> what an identification said
    const working = new Map(); // name -> the progress of its identification
    const forms = new Map(); // name -> the form for its columns
    let all = [];

    const load = async () => {
        try {
            all = await get("/api/recordings");
        } catch (error) {
            return complain(`The recordings can't be listed: ${error.message}`);
        }
        store.emit("library-names", new Set(all.map((each) => each.name)));
        compare.know(all.filter((each) => !each.deleted));
        show();
    };
    const act = async (name, what, body = {}) => {
        try {
            return await post(`/api/recordings/${encodeURIComponent(name)}/${what}`, body);
        } catch (error) {
            complain(`${words(what.split("/").at(-1))}: ${error.message}`);
            return null;
        }
    };
    const bringBack = async (name) => {
        if (await act(name, "undelete")) await load();
    };
    const remove = async (name) => {
        if (!(await act(name, "delete"))) return;
        compare.drop(name);
        await load();
        toast(`Deleted ${name}`, { title: "Undo", run: () => bringBack(name) });
    };
    const note = async (name, notes) => {
        if (await act(name, "notes", { notes })) toast(`The note on ${name} is saved`);
    };
    // The form for the columns of an imported file, opened where it is needed; it lives on while the list is made anew.
    const askColumns = async (name) => {
        if (forms.delete(name)) return show();
        try {
            const send = (answers) => post(`/api/recordings/${encodeURIComponent(name)}/columns`, answers);
            forms.set(name, await columnsForm(name, send, () => {
                document.activeElement.blur(); // or else the list would wait for what is being written there
                forms.delete(name);
                results.delete(name);
                toast(`The columns of ${name} are known now: it can be identified`);
                load();
            }));
        } catch (error) {
            return complain(`Columns of ${name}: ${error.message}`);
        }
        open.add(name);
        show();
        forms.get(name).querySelector("select").focus();
    };
    const identify = async (name) => {
        if (all.find((each) => each.name === name)?.columns === "open") {
            if (!forms.has(name)) await askColumns(name);
            return false;
        }
        const result = await act(name, "identify", { structure: "auto" });
        if (result) results.set(name, result);
        await load();
        return Boolean(result);
    };
    compare.identify = (name) => {
        showSelf(); // the form for its columns stands there
        return identify(name);
    };
    store.on("work", (message) => {
        const { name } = message;
        if (message.over) {
            working.get(name)?.over();
            working.delete(name);
            return load(); // with what came of it: what is known so far would say that nothing did
        }
        const begins = !working.has(name);
        if (begins) working.set(name, makeProgress(`Identifying ${name}`, () => act(name, "identify/end")));
        working.get(name).show(workProgress(message));
        if (begins) show();
    });
    const actions = { act, note, remove, bringBack, identify, askColumns, forms, open, results, working, compare, load };
    const show = () => {
        // A note that is being written isn't taken from under a person's hands.
        if (list.contains(document.activeElement) && document.activeElement.matches("textarea, form.columns *")) return;
        const focus = list.contains(document.activeElement) ? document.activeElement.id : null;
        const sought = search.value.trim().toLowerCase();
        const found = all.filter((each) => !each.deleted && `${each.name} ${each.notes ?? ""} ${signalName(each)}`.toLowerCase().includes(sought));
        list.replaceChildren(...found.map((each) => entry(each, actions)));
        if (!found.length) list.append(el("li", { class: "quiet none" }, all.length && sought ? "None found." : "None yet. Record makes one."));
        const deleted = all.filter((each) => each.deleted);
        if (deleted.length) list.append(deletedOnes(deleted, actions));
        if (focus) byId(focus)?.focus();
    };
    makeImport(async ({ name, open: unclear }) => {
        await load();
        if (unclear) await askColumns(name);
    });
    search.addEventListener("input", show);
    store.on("library", load);
    store.on("recorded", load);
    compare.onChange = show;
    return load;
}

// A file of somebody else's becomes a recording.
function makeImport(imported) {
    const file = byId("import-file");
    byId("import").addEventListener("click", () => file.click());
    file.addEventListener("change", async () => {
        const [chosen] = file.files;
        file.value = "";
        if (!chosen) return;
        const most = largestUpload();
        if (chosen.size > most) {
            return toast(`${chosen.name} has ${megabytes(chosen.size)}; ${megabytes(most)} at most can be imported. Take a part of it, or use servobench convert.`);
        }
        const begun = performance.now();
        const progress = makeProgress(`Importing ${chosen.name}`, () => sending.end());
        byId("import").parentElement.after(progress.element);
        const told = (sent, total) => progress.show(uploadProgress(sent, total, begun));
        const sending = upload(`/api/upload?name=${encodeURIComponent(chosen.name)}`, chosen, told);
        told(0, chosen.size);
        byId("import").disabled = true;
        try {
            const made = await sending.done;
            const renamed = made.name && made.name !== chosen.name.replace(/\.[^.]*$/, "");
            const sentence = `Imported ${chosen.name}${renamed ? ` as ${made.name}` : ""}${made.open ? "; say what its columns are" : ""}`;
            // What is missing of it is there until somebody has read it.
            if (made.warnings?.length) complain(`${sentence}. Reading it warns: ${fewOf(made.warnings)}`);
            else toast(sentence);
            await imported(made);
        } catch (error) {
            toast(`${chosen.name}: ${error.message}`);
        } finally {
            progress.over();
            byId("import").disabled = false;
        }
    });
}

const signalName = (recording) => (typeof recording.signal === "string" ? recording.signal : (recording.signal?.type ?? ""));

function entry(recording, actions) {
    const { name } = recording;
    const id = `recording-${slug(name)}`;
    const isOpen = actions.open.has(name);
    const body = el("div", { class: "details", id: `${id}-details`, hidden: !isOpen });
    const top = el(
        "button",
        {
            type: "button",
            id,
            class: "name",
            "aria-expanded": String(isOpen),
            "aria-controls": `${id}-details`,
            on: {
                click: () => {
                    body.hidden = !body.hidden;
                    top.setAttribute("aria-expanded", String(!body.hidden));
                    actions.open[body.hidden ? "delete" : "add"](name);
                },
            },
        },
        name,
    );
    body.append(...details(recording, id, actions));
    const chosen = actions.compare.has(name);
    const compared = el("input", {
        type: "checkbox",
        id: `${id}-compare`,
        set: { checked: chosen },
        "aria-label": `Compare ${name}`,
        on: { change: () => actions.compare.toggle(name) },
    });
    const facts = el("p", { class: "facts quiet" }, factsOf(recording), verdictMark(recording.verdict));
    const tick = el("label", { class: "tick" }, compared, el("span", { "aria-hidden": "true" }, "Compare"));
    return el("li", { class: "recording" }, el("div", { class: "head" }, top, tick), facts, body);
}

// What was deleted is kept for a while, and can be had back at any time.
function deletedOnes(recordings, actions) {
    const rows = recordings.map(({ name }) =>
        el(
            "li",
            { class: "row between" },
            el("span", { class: "quiet" }, name),
            el("button", { type: "button", class: "plain", "aria-label": `Bring ${name} back`, on: { click: () => actions.bringBack(name) } }, "Bring back"),
        ),
    );
    const summary = el("summary", {}, `Deleted (${rows.length})`);
    const opened = { set: { open: actions.open.has(DELETED) }, on: { toggle: ({ target }) => actions.open[target.open ? "add" : "delete"](DELETED) } };
    return el("li", { class: "deleted" }, el("details", opened, summary, el("ul", {}, rows)));
}

function factsOf(recording) {
    const created = new Date(recording.created);
    const when = Number.isNaN(created.valueOf()) ? "" : created.toLocaleString(undefined, { dateStyle: "short", timeStyle: "short" });
    const length = recording.columns === "open" ? "columns not known yet" : `${significant(recording.duration, 3)} s`;
    return [signalName(recording), length, when].filter(Boolean).join("  ·  ");
}

const SEVERITIES = { warning: "warn", refusal: "bad", danger: "bad" };
const LEVELS = { trusted: "ok", doubtful: "warn", refused: "bad" };

function verdictMark(verdict) {
    if (!verdict) return null;
    return el("span", { class: "verdict", "data-level": LEVELS[verdict] ?? "off" }, shape(), words(verdict));
}

function details(recording, id, actions) {
    const { name } = recording;
    const path = `/api/recordings/${encodeURIComponent(name)}/download`;
    const notes = el("textarea", {
        id: `${id}-notes`,
        rows: 2,
        placeholder: "Notes",
        set: { value: recording.notes ?? "" },
        on: { change: () => actions.note(name, notes.value) },
    });
    const going = actions.working.get(name);
    const identify = el("button", { type: "button", class: "plain", id: `${id}-identify`, "aria-disabled": String(Boolean(going)) }, going ? "Identifying …" : "Identify");
    identify.addEventListener("click", () => actions.working.has(name) || actions.identify(name));
    const row = el(
        "div",
        { class: "row" },
        identify,
        recording.columns ? el("button", { type: "button", class: "plain", id: `${id}-columns`, "aria-label": `Columns of ${name}`, "aria-expanded": String(actions.forms.has(name)), on: { click: () => actions.askColumns(name) } }, "Columns") : null,
        el("a", { class: "plain", href: `${path}?as=mcap`, download: true, "aria-label": `Download ${name} as MCAP` }, "MCAP"),
        el("a", { class: "plain", href: `${path}?as=csv`, download: true, "aria-label": `Download ${name} as CSV` }, "CSV"),
        el("button", { type: "button", class: "plain square", "aria-label": `Delete ${name}`, on: { click: () => actions.remove(name) } }, icon("bin")),
    );
    return [el("label", { for: `${id}-notes`, class: "hide" }, `Notes on ${name}`), notes, row, warningsOf(recording, actions.results.get(name)), actions.forms.get(name), going?.element, identified(recording, actions.results.get(name))].filter(Boolean);
}

// As many sentences as somebody reads in passing; all of them stand with the recording.
function fewOf(sentences) {
    const [left, few] = [sentences.length - 2, sentences.slice(0, 2).map(plainly).join("; ")];
    return left > 0 ? `${few}; and ${left} more, which stand with it` : few;
}

// What reading the file warned of, as long as no result beside it says the same.
function warningsOf({ warnings }, result) {
    const said = new Set((result?.findings ?? []).map(({ sentence }) => sentence));
    const left = (warnings ?? []).filter((each) => !said.has(each));
    return left.length ? el("ul", { class: "findings" }, left.map((each) => finding("warning", each))) : null;
}

const finding = (severity, sentence) => el("li", { "data-level": SEVERITIES[severity] ?? "off" }, shape(), el("span", {}, plainly(sentence)));

// What the identification said; a recording that was identified before still has its report.
function identified(recording, result) {
    const report = result?.report ?? (recording.verdict ? `/reports/${encodeURIComponent(recording.name)}` : null);
    const link = report && el("a", { class: "report", href: report, target: "_blank", rel: "noopener" }, `Open the report of ${recording.name}`);
    if (!result) return link;
    const rows = Object.entries(result.parameters ?? {}).map(([name, parameter]) => {
        const { value, interval, unit } = readable(parameter);
        return el(
            "li",
            {},
            el("span", { class: "name" }, words(name)),
            el("span", {}, el("strong", {}, significant(value, 4)), " ", el("span", { class: "unit" }, unit)),
            el("span", { class: "interval" }, interval ? `${significant(interval[0], 4)} to ${significant(interval[1], 4)}` : "no interval"),
        );
    });
    const findings = (result.findings ?? []).map(({ severity, sentence }) => finding(severity, sentence));
    return el(
        "div",
        { class: "result" },
        rows.length ? el("ul", { class: "values" }, rows) : null,
        link,
        findings.length ? el("ul", { class: "findings" }, findings) : null,
    );
}
