// The socket: says hello with the token, hands texts and frames on, and comes back when the connection is lost.

import { session, sessionToken } from "./api.js";

const FIRST_WAIT = 250; // ms
const LONGEST_WAIT = 4000; // ms

export class Socket {
    constructor({ onMessage, onFrame, onLink }) {
        Object.assign(this, { onMessage, onFrame, onLink });
        this.wait = FIRST_WAIT;
        this.link = null;
    }

    open() {
        const link = new WebSocket(`${location.protocol === "https:" ? "wss" : "ws"}://${location.host}/ws`);
        link.binaryType = "arraybuffer";
        link.addEventListener("open", () => {
            link.send(JSON.stringify({ do: "hello", token: sessionToken() }));
            this.link = link;
            this.wait = FIRST_WAIT;
            this.onLink(true);
        });
        link.addEventListener("message", ({ data }) => {
            if (typeof data === "string") this.onMessage(JSON.parse(data));
            else this.onFrame(data);
        });
        link.addEventListener("close", () => this.lost());
    }

    get connected() {
        return this.link !== null;
    }

    send(message) {
        if (!this.connected) return false;
        this.link.send(JSON.stringify(message));
        return true;
    }

    lost() {
        this.link = null;
        this.onLink(false);
        setTimeout(() => this.again(), this.wait);
        this.wait = Math.min(LONGEST_WAIT, 2 * this.wait);
    }

    // A server that was started anew has another token.
    async again() {
        try {
            await session();
            this.open();
        } catch {
            this.lost();
        }
    }
}
