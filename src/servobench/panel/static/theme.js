// The theme that was chosen, before anything is drawn; a classic script, so that the page never shows the other one first.

(() => {
    const THEMES = ["system", "dark", "light"];
    const TITLES = { system: "as the system", dark: "dark", light: "light" };
    const kept = "servobench-theme";
    let chosen = THEMES.includes(localStorage.getItem(kept)) ? localStorage.getItem(kept) : "system";

    const show = () => {
        if (chosen === "system") document.documentElement.removeAttribute("data-theme");
        else document.documentElement.dataset.theme = chosen;
        document.getElementById("theme")?.setAttribute("aria-label", `Theme: ${TITLES[chosen]}`);
        document.dispatchEvent(new CustomEvent("theme"));
    };
    show();
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", show);
    document.addEventListener("DOMContentLoaded", () => {
        show();
        document.getElementById("theme").addEventListener("click", () => {
            chosen = THEMES[(THEMES.indexOf(chosen) + 1) % THEMES.length];
            localStorage.setItem(kept, chosen);
            show();
        });
    });
})();
