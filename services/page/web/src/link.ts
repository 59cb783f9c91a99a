// The conversation with the server: it opens itself again, and every call ends.

import type { Answer, Asked, Call, History, Link, Log, Plan, Reply, Request, Robot, Scene, Seat, Sign, State, Swapped, Told, Welcome } from "./protocol.js";
import { sentence, t } from "./lang.js";

/** Time until a lost conversation is opened again, ms. */
const AGAIN_MS = 700;
/** Longest wait for a reply, ms: the gateway itself waits 10 s for a process. */
const REPLY_MS = 15_000;
/** Without any message for this time the conversation is opened again, ms: the server sends four states per second at least. */
const SILENT_MS = 4_000;
/** Time between two signs that a control is held, ms; the gateway ends the motion after 300 ms without one. */
const BEAT_MS = 75;
/** Reasons for which a motion is refused until the robot has come to rest: its numbers in the catalogue of answers. */
const NOT_AT_REST = [203, 206, 209];
/** Longest wait for the rest, and time between two attempts, ms. */
const REST_MS = 4000, ATTEMPT_MS = 60;
/** Time without an answer to a stop after which it is sent over plain HTTP too, ms: a connection may be dead and look alive. */
const STOP_MS = 500;
/** Longest wait for an answer to a stop over plain HTTP, ms: that is how long the server itself waits for the gateway. */
const PLAIN_MS = 3_000;
/** Time until a stop is seen in the state, ms. */
const SEEN_MS = 500;
/** By how much two clocks drift apart at most, as a share: a kernel that is told the time corrects its own by 500 ppm. */
const DRIFT = 5e-4;
/** An instant before any state, ms. */
const LONG_AGO_MS = -1e12;
const TOKEN = "nims-token";
const FREE: Seat = { reply: "seat", id: 0, flyer: null, asks: null, within_s: 0 };
const EVENTS = 200;

/** What is known of the robot; each part is replaced as a whole. */
export class Store {
    state: State | null = null;
    /** When `state` arrived, ms of the page's clock. */
    stateAt = -Infinity;
    scene: Scene | null = null;
    robot: Robot | null = null;
    plan: Plan | null = null;
    link: Link | null = null;
    welcome: Welcome | null = null;
    /** Who flies, and when that came, ms of the page's clock. */
    seat: Seat = FREE;
    seatAt = 0;
    /** Why this browser is not paired. */
    unpaired: string | null = null;
    /** Why there is no conversation. */
    trouble: string | null = t("connecting");
    events: (Log | Asked | Swapped)[] = [];
    history: History | null = null;
    /** By how much the clock of the server is ahead of that of the page by the state that came fastest in this conversation, ms; compared at that instant. */
    private ahead = -Infinity;
    private comparedAt = 0;
    /** By how much `state` came later than the fastest one, ms. */
    private late_ms = 0;
    private readonly listeners: (() => void)[] = [];

    onChange(listener: () => void): void { this.listeners.push(listener); }
    changed(): void { for (const listener of this.listeners) listener(); }

    /** Age of the state, s; infinite without one. A connection that is slow delivers states that are old already. */
    age_s(): number {
        const age_s = this.state?.age_s;
        return age_s == null ? Infinity : age_s + (this.late_ms + performance.now() - this.stateAt) / 1000;
    }

    /** Compares the clock of the server with this one: the state that came fastest counts, less what the clocks drift apart. */
    private compare(ahead_ms: number): void {
        const drift_ms = DRIFT * Math.max(0, this.stateAt - this.comparedAt);
        this.comparedAt = this.stateAt;
        this.ahead = Math.max(this.ahead - drift_ms, ahead_ms);
        this.late_ms = this.ahead - ahead_ms;
    }

    /** What a sign that a control is held carries: when it was made, and of when the robot is that could be seen, in time of the server. */
    sign(): Sign {
        const { state } = this;
        return { made_ms: performance.now() + this.ahead, seen_ms: state?.age_s == null ? LONG_AGO_MS : state.at_ms - 1000 * state.age_s };
    }

    /** An instant in time of the server as seconds of this browser's clock. */
    at_s(at_ms: number): number { return (Date.now() - performance.now() + at_ms - this.ahead) / 1000; }

    /** Whether this browser's role permits to fly. */
    get flies(): boolean { return this.welcome !== null && ["fly", "owner"].includes(this.welcome.role); }

    take(told: Told): void {
        switch (told.type) {
            case "state": this.state = told; this.stateAt = performance.now(); this.compare(told.at_ms - this.stateAt); break;
            case "scene": this.scene = told; break;
            case "robot": this.robot = told; break;
            case "plan": this.plan = told; break;
            case "link": this.link = told; break;
            case "welcome": this.welcome = told; this.trouble = null; this.seat = FREE; this.ahead = -Infinity; break;
            case "unreachable": this.trouble = told.sentence; break;
            case "history": this.history = told; break;
            case "log":
            case "swap":
            case "request":
                this.events.push(told);
                if (this.events.length > EVENTS) this.events.shift();
                break;
        }
        this.changed();
    }
}

/** A press of a control: all attempts at its motion have its number. It is over with the next press, and with a stop. */
export interface Press { number: number; isOver: () => boolean }

interface Waiting { done: (reply: Reply) => void; timer: number }

/** The conversation. */
export class Conversation {
    private socket: WebSocket | null = null;
    private lastId = 0;
    private heardAt = 0;
    private readonly waiting = new Map<number, Waiting>();
    private beats: number | null = null;
    /** The code of the address by which this page was opened. */
    private code: string | null;
    /** Number of stops by this browser. */
    private stops = 0;
    /** Number of presses that begin a motion. */
    private presses = 0;
    /** When it ended a motion last, by a stop or a release, ms of the page's clock. */
    private endedAt = -Infinity;

    constructor(private readonly store: Store) {
        this.code = /[#&]code=([0-9A-Za-z-]{8,12})/.exec(location.hash)?.[1] ?? null;
        // No secret stays in the address bar.
        if (this.code) history.replaceState(null, "", location.pathname);
        this.open();
        setInterval(() => { if (performance.now() - this.heardAt > SILENT_MS) this.socket?.close(); }, 1000);
    }

    /** Forgets the token of this browser. */
    unpair(): void { localStorage.removeItem(TOKEN); this.socket?.close(); }

    /** Gets a token for a code, or uses a token. */
    async pair(secret: string): Promise<void> {
        let token: string | null = /^[0-9a-f]{64}$/.test(secret.trim()) ? secret.trim() : null;
        if (token === null) {
            const reply = await this.call({ call: "pair", code: secret });
            if (reply.reply === "token") token = reply.secret;
            else this.store.unpaired = "sentence" in reply ? sentence("reason" in reply ? reply.reason : 0, reply.sentence) : t("the code was not taken");
        }
        if (token === null) { this.store.changed(); return; }
        this.store.unpaired = null;
        localStorage.setItem(TOKEN, token);
        this.socket?.close();
    }

    /** Asks to fly, or answers who asks. */
    async seat(what: "ask" | "give" | "keep"): Promise<Reply> { return this.call({ call: "seat", what }); }

    get isOpen(): boolean { return this.socket?.readyState === WebSocket.OPEN && this.store.trouble === null; }

    private open(): void {
        const socket = new WebSocket(`${location.protocol === "https:" ? "wss" : "ws"}://${location.host}/ws`);
        this.socket = socket;
        this.heardAt = performance.now();
        socket.onopen = () => socket.send(JSON.stringify({ call: "hello", token: localStorage.getItem(TOKEN) }));
        socket.onmessage = (event) => {
            this.heardAt = performance.now();
            this.take(JSON.parse(event.data as string) as Told | Reply);
        };
        socket.onclose = () => {
            this.store.trouble ??= t("the connection to the robot is lost; it is made again by itself");
            for (const id of [...this.waiting.keys()]) this.end(id, refusal(id, t("the connection was lost before the answer came; look what the robot does")));
            this.store.events = [];
            this.store.changed();
            setTimeout(() => this.open(), AGAIN_MS);
        };
    }

    private take(message: Told | Reply): void {
        if ("reply" in message) {
            if (message.reply === "seat") {
                this.store.seat = message;
                this.store.seatAt = performance.now();
                this.store.changed();
            } else this.end(message.id, message);
        } else {
            if (message.type === "welcome" && message.sentence) localStorage.removeItem(TOKEN);
            this.store.take(message);
            const code = this.code;
            if (message.type === "welcome" && code !== null) {
                this.code = null;
                if (!message.paired) void this.pair(code);
            }
        }
    }

    private end(id: number, reply: Reply): void {
        const waiting = this.waiting.get(id);
        if (!waiting) return;
        clearTimeout(waiting.timer);
        this.waiting.delete(id);
        waiting.done(reply);
    }

    /** Sends a call; the promise always ends with a reply, of the page itself if none comes. */
    call(call: Call, wait_ms = REPLY_MS): Promise<Reply> {
        const id = ++this.lastId;
        return new Promise((done) => {
            if (!this.isOpen) { done(refusal(id, this.store.trouble ?? t("there is no connection to the robot"))); return; }
            const timer = window.setTimeout(() => this.end(id, refusal(id, t("no answer has come; look what the robot does"))), wait_ms);
            this.waiting.set(id, { done, timer });
            this.socket?.send(JSON.stringify({ ...call, id }));
        });
    }

    /** Requests something of the robot. */
    async ask(request: Request, press: Press | null = null): Promise<Answer> {
        const reply = await this.call({ call: "ask", request, press: press?.number ?? null });
        return reply.reply === "answer" ? reply : refusal(reply.id, t("the reply is of another kind; load the page again"));
    }

    /** A control that begins a motion is pressed. */
    press(): Press {
        const number = ++this.presses, { stops } = this;
        return { number, isOver: () => number !== this.presses || stops !== this.stops };
    }

    /**
     * Requests a motion. Directly after a stop or a release the robot still comes to rest: then it is asked for again
     * until it rests, as long as it is `wanted` and the press is not over. Stops of others are compared by the server.
     */
    async whenAtRest(press: Press, attempt: () => Promise<Answer>, wanted: () => boolean = () => true): Promise<Answer> {
        const until = performance.now() + REST_MS;
        for (;;) {
            const answer = await attempt();
            if (!NOT_AT_REST.includes(answer.reason) || !wanted() || press.isOver() || performance.now() > until || !this.comesToRest) return answer;
            await new Promise((done) => setTimeout(done, ATTEMPT_MS));
            if (!wanted() || press.isOver()) return answer;
        }
    }

    /** Whether the robot is on the way to rest, or is about to be seen so. */
    private get comesToRest(): boolean {
        return this.store.state?.mode !== "following" || performance.now() - this.endedAt < SEEN_MS;
    }

    /** Stops the robot: over the conversation, and over plain HTTP where that is not there or does not answer. */
    async stop(verb: "stop" | "estop"): Promise<Answer> {
        this.stops += 1;
        this.endedAt = performance.now();
        if (!this.isOpen) return this.plainStop(verb);
        const asked = this.ask({ verb });
        const late = new Promise<null>((done) => setTimeout(() => done(null), STOP_MS));
        const answer = await Promise.race([asked, late]);
        // A refusal without a number is the page's own: the connection was lost.
        if (answer !== null && (answer.accepted === "accepted" || answer.reason !== 0)) return answer;
        const plain = await this.plainStop(verb);
        // What the conversation has answered meanwhile counts; on a dead connection it answers long after.
        const meanwhile = await Promise.race([asked, Promise.resolve(null)]);
        return plain.accepted !== "accepted" && meanwhile?.accepted === "accepted" ? meanwhile : plain;
    }

    /** Stops the robot without the conversation. */
    private async plainStop(verb: "stop" | "estop"): Promise<Answer> {
        try {
            const response = await fetch(`/plain/${verb}`, { method: "POST", signal: AbortSignal.timeout(PLAIN_MS) });
            const text = new DOMParser().parseFromString(await response.text(), "text/html").querySelector("#answer")?.textContent ?? "";
            return { reply: "answer", id: 0, accepted: response.ok && text !== "" && !text.startsWith("refused") ? "accepted" : "refused", reason: 0, sentence: text };
        } catch {
            return refusal(0, t("the robot cannot be reached: use the hardware stop"));
        }
    }

    /** Begins a motion that goes on until `release`, or until this page or its connection is gone. */
    async held(request: Request, press: Press): Promise<Answer> {
        this.release();
        if (this.store.state?.age_s == null) return refusal(0, t("Nothing has come from the robot"));
        const answered = this.call({ call: "held", request, sign: this.store.sign(), press: press.number });
        this.beats = window.setInterval(() => this.send({ call: "beat", sign: this.store.sign() }), BEAT_MS);
        const reply = await answered;
        return reply.reply === "answer" ? reply : refusal(reply.id, t("the reply is of another kind; load the page again"));
    }

    release(): void {
        if (this.beats === null) return;
        clearInterval(this.beats);
        this.beats = null;
        this.endedAt = performance.now();
        this.send({ call: "release" });
    }

    private send(message: { call: "beat"; sign: Sign } | { call: "release" }): void {
        if (this.socket?.readyState === WebSocket.OPEN) this.socket.send(JSON.stringify(message));
    }
}

function refusal(id: number, sentence: string): Answer {
    return { reply: "answer", id, accepted: "refused", reason: 0, sentence };
}
