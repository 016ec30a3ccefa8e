// Which device is driven, and with which settings.

import { toast } from "./announcer.js";
import { byId, el, say } from "./dom.js";
import { significant } from "./format.js";
import { permit, whyNot } from "./permit.js";
import { SettingsForm } from "./settings.js";

export const OPENING = 300000; // ms; a device may have to be found, and a simulated one's kernels to be compiled

export function makeDevice(store, commands, devices) {
    const dialog = byId("device-dialog");
    store.titles = new Map(devices.map(({ name, title }) => [name, title]));
    const settings = new SettingsForm({ prefix: "device", label: "Device", members: devices, onEdit: () => {} });
    const rate = el("input", { type: "number", id: "device-sample-time", min: 0.1, step: "any", value: 1 });
    const entry = el("span", { class: "entry" }, rate, el("span", { class: "unit" }, "ms"));
    const field = el("div", { class: "field" }, el("label", { for: "device-sample-time" }, "Sample time"), entry);
    byId("device-fields").append(settings.element, field);

    byId("device").addEventListener("click", () => {
        const { device, sample_time } = store.state ?? {};
        if (device) settings.show({ type: device.name, ...device.settings });
        if (sample_time) rate.value = Number((1000 * sample_time).toPrecision(6));
        byId("device-trouble").textContent = "";
        dialog.showModal();
    });
    byId("device-cancel").addEventListener("click", () => dialog.close());
    byId("device-form").addEventListener("submit", async (event) => {
        event.preventDefault();
        try {
            const { type, ...given } = settings.changed();
            const asked = { do: "open", device: { name: type, settings: given }, sample_time: Number(rate.value) / 1000 };
            dialog.close(); // how it goes on is told where everybody sees it
            const outcome = await commands.ask(asked, OPENING);
            if (outcome.accepted) return;
            byId("device-trouble").textContent = outcome.why;
            dialog.showModal();
        } catch (error) {
            byId("device-trouble").textContent = error.message;
        }
    });
    store.on("proposed", ({ sample_time }) => {
        if (!sample_time || !store.state || sample_time === store.state.sample_time) return;
        toast(`This asks for a sample time of ${significant(1000 * sample_time, 4)} ms; it is set where the device is chosen.`);
    });
    store.on("state", (state) => {
        permit(byId("device"), whyNot(state));
        say(byId("device-name"), state.device ? store.titleOf(state.device.name) : "none");
        say(byId("device-rate"), state.sample_time ? `${Number((1 / state.sample_time).toPrecision(4))} Hz` : "");
    });
}
