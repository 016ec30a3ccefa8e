// Views that other modules bring, when they're looked at for the first time: `mount(element, api)`, and a style sheet beside it.

import { get, post } from "./api.js";
import { OPENING } from "./device.js";
import { byId, el } from "./dom.js";

const EXTRAS = { "tab-diagram": "diagram", "tab-exercises": "exercises" };

const rate = (sampleTime) => `${Number((1 / sampleTime).toPrecision(4))} Hz`;

// Put an experiment before the operator; resolves to what else was changed for it. What turns isn't changed: there, signal and controller wait to be applied.
async function propose(store, commands, experiment) {
    const { operator, enabled, device, sample_time } = store.state ?? {};
    const wanted = experiment.sample_time;
    let set = "";
    if (operator && !enabled && wanted && wanted !== sample_time) {
        const asked = { do: "open", device: { name: device.name, settings: device.settings }, sample_time: wanted };
        const outcome = await commands.ask(asked, OPENING);
        if (!outcome.accepted) throw new Error(outcome.why);
        set = `It is now sampled at ${rate(wanted)}, no longer at ${rate(sample_time)}; the device was reopened for that.`;
    }
    store.emit("proposed", experiment);
    return set;
}

export function makeExtras(store, commands) {
    const mounted = new Map(); // name -> what mount returned
    const api = { get, post, set: (experiment) => propose(store, commands, experiment) };

    const mountExtra = async (tab) => {
        const name = EXTRAS[tab];
        if (!name) return;
        if (mounted.has(name)) return refresh(name);
        mounted.set(name, null);
        try {
            const { mount } = await import(`./${name}.js`);
            document.head.append(el("link", { rel: "stylesheet", href: `/static/${name}.css` }));
            const made = mount(byId(name), api);
            mounted.set(name, made ?? null);
            await (made?.ready ?? made);
        } catch (error) {
            mounted.delete(name);
            byId(name).replaceChildren(el("p", { class: "quiet none" }, `This part can't be shown: ${error.message}`));
        }
    };
    const refresh = async (name) => {
        if (byId(name).closest("[role=tabpanel]").hidden) return;
        if (!mounted.has(name)) return mountExtra(`tab-${name}`); // it failed before, while the device was being opened for instance
        try {
            await mounted.get(name)?.refresh?.();
        } catch (error) {
            byId(name).replaceChildren(el("p", { class: "quiet none" }, `This part can't be shown: ${error.message}`));
            mounted.delete(name);
        }
    };
    // The chain that is drawn is the one in force.
    let held = "";
    store.on("state", ({ signal, controller, chain, device, sample_time }) => {
        const now = JSON.stringify([signal, controller, chain, device, sample_time]);
        if (now !== held) refresh("diagram");
        held = now;
    });
    return mountExtra;
}
