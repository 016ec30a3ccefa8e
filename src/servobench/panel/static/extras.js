// Views that other modules bring, when they're looked at for the first time: `mount(element, api)`, and a style sheet beside it.

import { get, post } from "./api.js";
import { byId, el } from "./dom.js";

const EXTRAS = { "tab-diagram": "diagram", "tab-exercises": "exercises" };

export function makeExtras(store) {
    const mounted = new Map(); // name -> what mount returned
    const api = { get, post, set: async (experiment) => store.emit("proposed", experiment) };

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
