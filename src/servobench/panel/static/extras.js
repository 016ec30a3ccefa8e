// Views that other modules bring, when they're looked at for the first time.

import { byId, el } from "./dom.js";

const EXTRAS = { "tab-diagram": ["diagram", "./diagram.js"], "tab-exercises": ["exercises", "./exercises.js"] };
const mounted = new Set();

export async function mountExtra(tab) {
    if (!(tab in EXTRAS) || mounted.has(tab)) return;
    mounted.add(tab);
    const [place, module] = EXTRAS[tab];
    try {
        const { mount } = await import(module);
        await mount(byId(place));
    } catch (error) {
        mounted.delete(tab);
        byId(place).replaceChildren(el("p", { class: "quiet none" }, `This part can't be shown: ${error.message}`));
    }
}
