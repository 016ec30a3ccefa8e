// Requests to the server the page came from, with the session's token; a refusal is an error with the server's sentence.

let token = "";

export async function session() {
    const found = await get("/api/session");
    token = found.token;
    return found;
}

export const sessionToken = () => token;

export async function get(path) {
    return (await checked(await fetch(path, { headers: { Accept: "application/json" } }))).json();
}

export async function bytes(path) {
    return (await checked(await fetch(path))).arrayBuffer();
}

export const post = (path, body = {}) => send(path, "application/json", JSON.stringify(body));

export const upload = (path, file) => send(path, "application/octet-stream", file);

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
    throw new Error(sentence);
}
