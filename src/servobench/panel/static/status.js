// Whether a setting holds: the chip beside it says so by word and shape, never by colour alone.

import { say } from "./dom.js";
import { fixed } from "./format.js";

const WORDS = { edited: "Not sent", pending: "Pending", applied: "Applied", refused: "Refused", silent: "No answer", unstarted: "Not started", unknown: "Not known now", none: "" };

export function showStatus(chip, status, detail = "") {
    chip.dataset.status = status;
    say(chip, [WORDS[status], detail].filter(Boolean).join({ applied: " at ", silent: " " }[status] ?? ": "));
}

// Why something that was asked for doesn't hold, as a sentence: a silence is no refusal.
export const failed = ({ silent, why }) => (silent ? `${WORDS.silent} ${why}` : `${WORDS.refused}: ${why}`);

// Ask for something and show what becomes of it; resolves to the outcome.
export async function track(chip, commands, message, patience = undefined) {
    const turn = Symbol("turn");
    chip.turn = turn;
    showStatus(chip, "pending");
    const outcome = await commands.ask(message, patience);
    if (chip.turn !== turn) return outcome; // something newer was asked for meanwhile
    if (outcome.accepted) showStatus(chip, "applied", outcome.time == null ? "" : `${fixed(outcome.time, 2)} s`);
    else showStatus(chip, outcome.silent ? "silent" : "refused", outcome.why ?? "the loop gave no reason");
    return outcome;
}

// Without a connection a chip that says that something holds says that this isn't known; with one again, that it does.
export function followLink(chip, { unknown }) {
    if (unknown && chip.dataset.status === "applied") showStatus(chip, "unknown");
    else if (!unknown && chip.dataset.status === "unknown") showStatus(chip, "applied");
}
