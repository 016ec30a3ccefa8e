// What is known now, and who wants to hear of it. Kinds are those of the server's messages and a few of the page's own.

export class Store {
    constructor() {
        this.state = null;
        this.titles = new Map(); // of devices, by name
        this.mayDrive = true; // whether this page may become the operator's at all
        this.listeners = new Map();
    }

    titleOf(device) {
        return this.titles.get(device) ?? device;
    }

    on(kind, listener) {
        if (!this.listeners.has(kind)) this.listeners.set(kind, []);
        this.listeners.get(kind).push(listener);
    }

    emit(kind, message) {
        if (kind === "state") this.state = message;
        for (const listener of this.listeners.get(kind) ?? []) listener(message);
    }
}
