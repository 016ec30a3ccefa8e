// Tabs: one in the order of the Tab key, arrows go to the others, and each shows its panel.

import { byId } from "./dom.js";

export function makeTabs(list, onShow = () => {}) {
    const tabs = [...list.querySelectorAll("[role=tab]")];
    const show = (chosen) => {
        for (const tab of tabs) {
            const selected = tab === chosen;
            tab.setAttribute("aria-selected", String(selected));
            tab.tabIndex = selected ? 0 : -1;
            byId(tab.getAttribute("aria-controls")).hidden = !selected;
        }
        onShow(chosen.id);
    };
    const moves = { ArrowRight: 1, ArrowLeft: -1 };
    list.addEventListener("click", ({ target }) => {
        const tab = target.closest("[role=tab]");
        if (tab) show(tab);
    });
    list.addEventListener("keydown", (event) => {
        const at = tabs.indexOf(document.activeElement);
        let next = null;
        if (event.key in moves) next = tabs[(at + moves[event.key] + tabs.length) % tabs.length];
        if (event.key === "Home") next = tabs[0];
        if (event.key === "End") next = tabs[tabs.length - 1];
        if (!next) return;
        event.preventDefault();
        next.focus();
        show(next);
    });
    return { show: (id) => show(byId(id)) };
}
