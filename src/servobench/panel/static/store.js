// What is known now, and who wants to hear of it. Kinds are those of the server's messages and a few of the page's own.

export class Store {
    constructor() {
        this.state = null;
        this.link = "lost"; // or "connected", "silent": open, but nothing comes, or "unknown": the server doesn't know this page
        this.titles = new Map(); // of devices, by name
        this.mayDrive = true; // whether this page may become the operator's at all
        this.beforeStart = async () => ""; // does what comes before a start; why the motor can't be started, "" where it can
        this.listeners = new Map();
    }

    titleOf(device) {
        return this.titles.get(device) ?? device;
    }

    on(kind, listener) {
        if (!this.listeners.has(kind)) this.listeners.set(kind, []);
        this.listeners.get(kind).push(listener);
    }

    // How things are isn't known while nothing is heard. Of a silence that ends what was heard last is still the newest; after a
    // connection that was lost the next one begins with how things are.
    turn(link) {
        const before = this.link;
        this.link = link;
        if (!this.state || (link === "connected" && before !== "silent")) return;
        this.emit("state", { ...this.state, unknown: link !== "connected" });
    }

    emit(kind, message) {
        if (kind === "state") this.state = message;
        if (kind === "link") this.turn(message);
        for (const listener of this.listeners.get(kind) ?? []) listener(message);
    }
}
