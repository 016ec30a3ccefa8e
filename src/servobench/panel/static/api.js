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

export async function post(path, body = {}, options = {}) {
    const headers = { "Content-Type": "application/json", "X-Servobench-Token": token };
    const answer = await fetch(path, { method: "POST", headers, body: JSON.stringify(body), ...options });
    return (await checked(answer)).json();
}

async function checked(answer) {
    if (answer.ok) return answer;
    let sentence = `the server answered ${answer.status} to ${new URL(answer.url).pathname}`;
    if (answer.headers.get("Content-Type")?.startsWith("application/json")) {
        sentence = (await answer.json()).error ?? sentence;
    }
    throw new Error(sentence);
}
