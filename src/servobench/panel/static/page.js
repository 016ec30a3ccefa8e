// The page: what belongs to what.

import { get, session } from "./api.js";
import { complain, toast } from "./announcer.js";
import { makeBeat } from "./beat.js";
import { Commands } from "./commands.js";
import { makeCompare } from "./compare.js";
import { makeController, makeCutoff, makeStart } from "./controls.js";
import { makeDevice } from "./device.js";
import { byId } from "./dom.js";
import { makeExtras } from "./extras.js";
import { decode } from "./frames.js";
import { makeGenerator } from "./generator.js";
import { makeLease } from "./lease.js";
import { makeFreshness, makeLink } from "./link.js";
import { makeLights, makeRecord } from "./lights.js";
import { makeLive } from "./live.js";
import { makeOpening } from "./permit.js";
import { makeReadings } from "./readings.js";
import { makeRecordings } from "./recordings.js";
import { Scopes } from "./scopes.js";
import { Socket } from "./socket.js";
import { makeStop } from "./stop.js";
import { Store } from "./store.js";
import { makeCursorStrip, makeTriggerStrip } from "./strips.js";
import { makeTabs } from "./tabs.js";
import { makeTools } from "./tools.js";

const store = new Store();

function makeScopes() {
    const scopes = new Scopes(store);
    const shows = [makeTools(scopes), makeTriggerStrip(scopes), makeCursorStrip(scopes)];
    const read = makeReadings(scopes);
    scopes.onView = () => shows.forEach((show) => show());
    scopes.onRead = () => {
        read();
        shows.slice(1).forEach((show) => show());
    };
    scopes.onView();
    let controller = "";
    store.on("state", (state) => {
        if (state.sample_time) scopes.setSampleTime(state.sample_time);
        const now = JSON.stringify(state.controller ?? null);
        if (now !== controller) scopes.setUnits(state.controller);
        controller = now;
    });
    return scopes;
}

function makeConnection(scopes) {
    const socket = new Socket({
        onMessage: (message) => {
            if (message.kind === "answer") commands.answered(message);
            else if (message.kind === "applied") commands.applied(message);
            store.emit(message.kind, message);
        },
        onFrame: (buffer) => scopes.take(decode(buffer)),
        onLink: (status) => {
            if (status === "lost") commands.lost();
            store.emit("link", status);
        },
    });
    const commands = new Commands((message) => socket.send(message));
    return { socket, commands };
}

// Why the motor was stopped; of a motor that is driven again it's no longer so.
function makeStopped(store) {
    let away = () => {};
    store.on("stopped", (message) => (away = toast(message.sentence ?? "Stopped")));
    store.on("state", ({ enabled }) => enabled && away());
}

async function begin() {
    const scopes = makeScopes();
    const { socket, commands } = makeConnection(scopes);
    makeStop(store, commands); // first of all
    makeLink(store);
    makeFreshness(store, scopes);
    makeBeat(store, scopes, socket);
    const mountExtra = makeExtras(store, commands);
    const views = makeTabs(byId("views"), (tab) => {
        byId("keep").hidden = tab !== "tab-scopes";
        mountExtra(tab);
    });
    const results = makeTabs(byId("results"), mountExtra);
    const compare = makeCompare(() => views.show("tab-compare"), store);
    const loadRecordings = makeRecordings(store, compare, () => results.show("tab-recordings"));
    makeOpening(store);
    makeLights(store, commands);
    makeRecord(store, commands);
    makeLive(store, commands);
    makeStart(store, commands);
    makeCutoff(store, commands);
    makeStopped(store);
    try {
        store.mayDrive = (await session()).operator;
        const catalogue = await get("/api/catalogue");
        makeGenerator(store, commands, catalogue.signals);
        makeController(store, commands, catalogue.controllers, scopes);
        makeDevice(store, commands, catalogue.devices);
    } catch (error) {
        complain(`The panel can't begin: ${error.message}`);
        return;
    }
    makeLease(store, commands);
    socket.open();
    await loadRecordings();
    document.body.classList.add("ready");
}

begin();
