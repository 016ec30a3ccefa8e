// Requests to the server the page came from, with the session's token; a refusal is an error with the server's sentence.

let token = "";
let largest = Infinity; // bytes that may be sent as a file

// `patience` [ms]: where nobody answers, a request would wait for minutes.
export async function session(patience = 60000) {
    const found = await get("/api/session", patience);
    token = found.token;
    largest = found.largest_upload ?? Infinity;
    return found;
}

export const sessionToken = () => token;

export async function get(path, patience = null) {
    const signal = patience === null ? undefined : AbortSignal.timeout(patience);
    return (await checked(await fetch(path, { headers: { Accept: "application/json" }, signal }))).json();
}

export async function bytes(path) {
    return (await checked(await fetch(path))).arrayBuffer();
}

export const post = (path, body = {}) => send(path, "application/json", JSON.stringify(body));

export const largestUpload = () => largest;

// A file on its way: {done, a promise; end()}. `onProgress(sent, total)` is called meanwhile: fetch doesn't tell that.
export function upload(path, file, onProgress) {
    const request = new XMLHttpRequest();
    const done = new Promise((resolve, reject) => {
        request.upload.addEventListener("progress", ({ loaded, total }) => onProgress(loaded, total));
        request.addEventListener("error", () => reject(new Error("the connection was lost")));
        request.addEventListener("abort", () => reject(new Error("it was ended before everything was sent")));
        request.addEventListener("load", () => {
            let said = {};
            try {
                said = JSON.parse(request.responseText);
            } catch {
                // A proxy's answer, for instance; its status tells enough.
            }
            if (request.status < 300) resolve(said);
            else reject(new Error(said.error ?? `the server answered ${request.status}`));
        });
    });
    request.open("POST", path);
    request.setRequestHeader("Content-Type", "application/octet-stream");
    request.setRequestHeader("X-Servobench-Token", token);
    request.send(file);
    return { done, end: () => request.abort() };
}

async function send(path, type, body) {
    const headers = { "Content-Type": type, "X-Servobench-Token": token };
    return (await checked(await fetch(path, { method: "POST", headers, body }))).json();
}

async function checked(answer) {
    if (answer.ok) return answer;
    let sentence = `the server answered ${answer.status} to ${new URL(answer.url).pathname}`;
    if (answer.headers.get("Content-Type")?.startsWith("application/json")) {
        sentence = (await answer.json()).error ?? sentence;
    }
    throw Object.assign(new Error(sentence), { status: answer.status });
}
