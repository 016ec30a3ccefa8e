// The socket: says hello with the token, hands texts and frames on, and comes back when the connection is lost. A connection that
// nothing comes from is no connection: the server says something three times a second.

import { session, sessionToken } from "./api.js";

const FIRST_WAIT = 250; // ms
const LONGEST_WAIT = 4000; // ms
const LOOK = 200; // ms between two looks at when something was heard
const SILENCE = 900; // ms; with a look's length that is told within 1.1 s
const GIVEN_UP = 3000; // ms of silence, or without a connection, after which another one is tried
const UNKNOWN = 401; // the status of an answer to who isn't let in
const BUSY = 600; // ms between two looks: the page itself had no time, and what came waits to be read

export class Socket {
    // `onLink` is told "connected", "silent", "lost", or "unknown" where the server is there and doesn't know this page; once each time.
    constructor({ onMessage, onFrame, onLink }) {
        Object.assign(this, { onMessage, onFrame, onLink });
        this.wait = FIRST_WAIT;
        this.trying = null; // the connection that is made, or is there
        this.link = null; // the one that is there
        this.status = "";
        this.heard = this.looked = performance.now();
        setInterval(() => this.look(), LOOK);
    }

    open() {
        const link = new WebSocket(`${location.protocol === "https:" ? "wss" : "ws"}://${location.host}/ws`);
        this.trying = link;
        this.heard = performance.now();
        link.binaryType = "arraybuffer";
        link.addEventListener("open", () => {
            if (link !== this.trying) return link.close();
            link.send(JSON.stringify({ do: "hello", token: sessionToken() }));
            this.link = link;
            this.wait = FIRST_WAIT;
            this.hear();
        });
        link.addEventListener("message", ({ data }) => {
            if (link !== this.trying) return; // it was given up
            this.hear();
            if (typeof data === "string") this.onMessage(JSON.parse(data));
            else this.onFrame(data);
        });
        link.addEventListener("close", () => link === this.trying && this.lost());
    }

    send(message) {
        if (!this.link) return false;
        this.link.send(JSON.stringify(message));
        return true;
    }

    hear() {
        this.heard = performance.now();
        this.tell("connected");
    }

    tell(status) {
        if (status === this.status) return;
        this.status = status;
        this.onLink(status);
    }

    look() {
        const now = performance.now();
        const busy = now - this.looked > BUSY && !document.hidden;
        this.looked = now;
        if (!this.trying || busy) return;
        const silent = now - this.heard;
        if (silent > GIVEN_UP) {
            this.trying.close(); // which may take long: nobody answers
            this.lost();
        } else if (silent > SILENCE && this.link) this.tell("silent");
    }

    lost(how = "lost") {
        this.link = this.trying = null;
        this.tell(how);
        setTimeout(() => this.again(), this.wait);
        this.wait = Math.min(LONGEST_WAIT, 2 * this.wait);
    }

    // A server that was started anew has another token, and lets nobody in who was let in before; its address in another tab helps
    // this one, too.
    async again() {
        try {
            await session(LONGEST_WAIT);
            this.open();
        } catch (error) {
            this.lost(error.status === UNKNOWN ? "unknown" : "lost");
        }
    }
}
