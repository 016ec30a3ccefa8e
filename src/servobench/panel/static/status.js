// Whether a setting holds: the chip beside it says so by word and shape, never by colour alone.

import { say } from "./dom.js";
import { fixed } from "./format.js";

const WORDS = { edited: "Not sent", pending: "Pending", applied: "Applied", refused: "Refused", none: "" };

export function showStatus(chip, status, detail = "") {
    chip.dataset.status = status;
    say(chip, [WORDS[status], detail].filter(Boolean).join(status === "applied" ? " at " : ": "));
}

// Ask for something and show what becomes of it; resolves to the outcome.
export async function track(chip, commands, message, patience = undefined) {
    const turn = Symbol("turn");
    chip.turn = turn;
    showStatus(chip, "pending");
    const outcome = await commands.ask(message, patience);
    if (chip.turn !== turn) return outcome; // something newer was asked for meanwhile
    if (outcome.accepted) showStatus(chip, "applied", outcome.time == null ? "" : `${fixed(outcome.time, 2)} s`);
    else showStatus(chip, "refused", outcome.why ?? "the loop gave no reason");
    return outcome;
}
