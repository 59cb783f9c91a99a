// The conversation of the page without a browser: what it does on connections that are slow or dead.
//
//     node conversation.cjs BUNDLE      BUNDLE: src/link.ts as CommonJS

const assert = require("node:assert/strict");

// What a browser has and Node.js has not.
const stored = [], sockets = [], fetched = [];
let now = 1000;
const define = (name, value) => Object.defineProperty(globalThis, name, { value, configurable: true, writable: true });
define("window", globalThis);
define("navigator", { languages: [] });
define("document", { documentElement: {} });
define("performance", { now: () => now });
define("localStorage", { getItem: () => null, setItem: (...row) => stored.push(row), removeItem: () => {} });
define("location", { protocol: "http:", host: "robot", hash: `#token=${"0".repeat(64)}`, pathname: "/" });
define("history", { replaceState: () => {} });
define("WebSocket", class {
    static OPEN = 1;
    readyState = 1;
    sent = [];
    constructor() { sockets.push(this); }
    send(text) { this.sent.push(JSON.parse(text)); }
    close() { this.readyState = 3; this.onclose?.(); }
});
// No request over HTTP is answered.
define("fetch", (path, options) => new Promise((_, refuse) => {
    fetched.push(path);
    options.signal?.addEventListener("abort", () => refuse(options.signal.reason));
}));

const { Store, Conversation } = require(process.argv[2]);
const pause = (ms) => new Promise((done) => setTimeout(done, ms));
const store = new Store(), conversation = new Conversation(store), [socket] = sockets;
const tell = (told) => socket.onmessage({ data: JSON.stringify(told) });
const state = (at_ms, age_s) => tell({ type: "state", at_ms, age_s, mode: "holding" });
const refusal = { reply: "answer", id: 0, accepted: "refused", reason: 209, sentence: "the robot is moving" };
const jog = { verb: "jog", cable: 1, distance_m: 0.1 };

async function run() {
    // No token is taken from the address.
    assert.deepEqual(stored.filter(([, value]) => value.startsWith("0000")), []);
    socket.onopen();
    tell({ type: "welcome", robot: "lab", user: "ada", role: "fly", paired: true, sentence: null, version: "0" });

    // What comes late is as old as it is late, however long that lasts.
    for (let i = 0; i < 20; i += 1, now += 50) state(now + 4000, 0.05);
    assert.ok(Math.abs(store.age_s() - 0.1) < 0.01, String(store.age_s()));
    for (let i = 0; i < 400; i += 1, now += 50) {
        state(now + 2000, 0.05);
        assert.ok(store.age_s() > 2 && store.age_s() < 2.1, String(store.age_s()));
    }
    const sign = store.sign();
    assert.ok(Math.abs(sign.made_ms - now - 4000) < 50 && Math.abs(sign.seen_ms - now - 1900) < 1, JSON.stringify(sign));

    // A motion is steered by the age of the robot's own state, and by none there is no motion.
    state(now + 4000, 1.5);
    assert.equal(store.sign().seen_ms, now + 2500);
    state(now + 4000, null);
    const before = socket.sent.length, blind = await conversation.held(jog, conversation.press());
    assert.ok(blind.accepted === "refused" && socket.sent.length === before, JSON.stringify(blind));
    state(now + 4000, 0);

    // All attempts of a press have its number. A press is over with the next one, and with a stop.
    const press = conversation.press();
    for (let i = 0; i < 2; i += 1) {
        const answered = conversation.held(jog, press);
        tell({ ...refusal, id: socket.sent.at(-1).id });
        assert.equal((await answered).reason, 209);
        assert.equal(socket.sent.findLast((call) => call.call === "held").press, press.number);
        conversation.release();
    }
    for (const ends of [() => conversation.press(), () => void conversation.stop("stop")]) {
        let attempts = 0;
        const tried = conversation.whenAtRest(conversation.press(), async () => { attempts += 1; return refusal; });
        await pause(300);
        assert.ok(attempts > 1);
        ends();
        const so = attempts;
        assert.equal((await tried).reason, 209);
        assert.equal(attempts, so);
    }

    // A stop over a dead connection is answered soon; the answer of the conversation counts if it comes.
    const hurried = async (stopped) => Promise.race([stopped, pause(10_000).then(() => assert.fail("no answer"))]);
    const begun = Date.now(), dead = await hurried(conversation.stop("stop"));
    assert.ok(dead.accepted === "refused" && dead.sentence.includes("hardware stop"), JSON.stringify(dead));
    assert.ok(Date.now() - begun >= 3000 && fetched.at(-1) === "/plain/stop");
    const late = conversation.stop("estop"), { id } = socket.sent.at(-1);
    setTimeout(() => tell({ reply: "answer", id, accepted: "accepted", reason: 1, sentence: "stopped" }), 1000);
    assert.equal((await hurried(late)).accepted, "accepted");
}

run().then(() => process.exit(0), (error) => { console.error(error); process.exit(1); });
