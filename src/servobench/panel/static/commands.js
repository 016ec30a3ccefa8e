// What was asked for, until it's known what became of it. The server's answer says that the loop was told; only the loop's own
// word, `applied` with the same number, says that it holds.

export class Commands {
    constructor(send, patience = 5000) {
        this.send = send;
        this.patience = patience; // ms
        this.last = 0;
        this.asked = new Map(); // id -> {resolve, timer}
        this.given = new Map(); // number -> {resolve, timer}
        this.early = new Map(); // number -> acknowledgement that came before the answer
    }

    // Resolves to {accepted, tick, time, why, silent}, with the time of the run [s]; never rejects, as a refusal is a result.
    // `silent` is true where nobody answered.
    ask(message, patience = this.patience) {
        const id = ++this.last;
        return new Promise((resolve) => {
            const finish = (outcome) => {
                clearTimeout(timer);
                this.asked.delete(id);
                resolve(outcome);
            };
            const silence = `in ${patience / 1000} s, so that it isn't known whether it holds. Try again; where nothing answers, press STOP, and switch off the supply if the motor turns`;
            const timer = setTimeout(() => finish({ accepted: false, silent: true, why: silence }), patience);
            this.asked.set(id, finish);
            if (!this.send({ ...message, id })) finish({ accepted: false, why: "not connected; nothing was sent" });
        });
    }

    answered(answer) {
        const finish = this.asked.get(answer.id);
        if (!finish) return;
        if (!answer.ok) return finish({ accepted: false, why: answer.error });
        if (answer.number == null) return finish({ accepted: true, tick: null });
        const early = this.early.get(answer.number);
        if (early) return finish(early);
        this.given.set(answer.number, finish);
    }

    applied(word) {
        const outcome = { accepted: word.accepted, tick: word.tick, time: word.time, why: word.why };
        const finish = this.given.get(word.number);
        if (finish) {
            this.given.delete(word.number);
            return finish(outcome);
        }
        this.early.set(word.number, outcome);
        if (this.early.size > 64) this.early.delete(this.early.keys().next().value);
    }

    // Nothing that was under way will be answered.
    lost() {
        for (const finish of [...this.asked.values()]) finish({ accepted: false, why: "the connection was lost" });
        this.given.clear();
        this.early.clear();
    }
}
