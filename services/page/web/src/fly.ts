// The view from which the robot is flown.

import { h, metres, renew, write } from "./dom.js";
import { question } from "./question.js";
import type { Conversation, Store } from "./link.js";
import { FlatMap } from "./map.js";
import type { Answer, Point, Request } from "./protocol.js";
import { Space } from "./space.js";
import { type Drawn, bounds, extend, isActive, missionText, nodeOf } from "./view.js";
import { sentence, t, told, translate } from "./lang.js";

/** Time without a change after which a target is checked, ms. */
const SETTLED_MS = 120;
/** Time for which new actions take no tap, ms: it was meant for what stood there before. */
const RENEWED_MS = 500;
/** A held motion: how far it goes, m, with the next distance if the one before is refused, and how fast a move is, m/s. */
const REACHES_M = [1, 0.3, 0.1], SLOW_M_S = 0.08;
/** Deflection of a stick below which it rests, and time between two looks at it, ms. */
const RESTS = 0.35, STICK_MS = 50;
/** The views of the drawing. */
const LOOKS: Record<string, string> = { "3-D": t("3-D"), Top: t("Top"), Side: t("Side") };
/** The six directions of the pad. */
const DIRECTIONS: [string, string, Point][] = [
    ["−x", t("to the left: x falls"), [-1, 0, 0]], ["+x", t("to the right: x grows"), [1, 0, 0]], ["−y", t("to the front: y falls"), [0, -1, 0]], ["+y", t("to the back: y grows"), [0, 1, 0]],
    [t("▲ up"), t("up: z grows"), [0, 0, 1]], [t("▼ down"), t("down: z falls"), [0, 0, -1]],
];

export class Fly {
    readonly element: HTMLElement;
    readonly drawn: Drawn = { trail: [], target: null, preview: [] };
    private readonly flat: FlatMap;
    private readonly space: Space | null = null;
    private readonly looks: Record<string, HTMLButtonElement> = {};
    private look = "3-D";
    private readonly answer = h("p", { class: "answer", role: "status", hidden: true });
    private readonly place = h("p", { class: "big" }, "–");
    private readonly told = h("div", { class: "table" });
    private readonly acts = h("div", { class: "row" });
    /** When the actions changed, ms of the page's clock. */
    private actsAt = -Infinity;
    private readonly progress = h("i");
    private readonly mission = h("p");
    private readonly heightSlider = h("input", { type: "range", step: 0.05, "aria-label": t("height of the target"), input: () => this.aim({ 2: this.heightSlider.valueAsNumber }) });
    private readonly fields = (["x", "y", "z"] as const).map((name, axis) => h("input", { inputmode: "decimal", "aria-label": t("{axis} of the target in metres", { axis: name }), change: () => this.aim({ [axis]: Number(this.fields[axis]!.value.replace(",", ".")) }) }));
    private readonly finding = h("p", { class: "soft", role: "status" }, t("Tap a point in the drawing, or enter one."));
    private readonly go = h("button", { class: "button main wide", type: "button", disabled: true, click: () => this.fly() }, t("Go there"));
    private readonly cables = h("div", { class: "table" });
    private readonly pad = h("div", { class: "pad" });
    private checking = 0;
    private readonly legend = h("div", { class: "legend", "aria-hidden": true });

    constructor(private readonly store: Store, private readonly conversation: Conversation) {
        const tapped = (at: Partial<Record<0 | 1 | 2, number>>) => this.aim(at);
        this.flat = new FlatMap(store, this.drawn, tapped);
        try {
            this.space = new Space(store, this.drawn, () => this.drawn.target?.at[2] ?? this.heightSlider.valueAsNumber, tapped);
        } catch {
            this.look = "Top"; // no WebGL here
        }
        const choice = h("div", { class: "choice", role: "group", "aria-label": t("view") }, ...["3-D", "Top", "Side"].filter((look) => look !== "3-D" || this.space).map((look) => {
            this.looks[look] = h("button", { type: "button", click: () => this.show(look) }, LOOKS[look] ?? look);
            return this.looks[look]!;
        }));
        const stage = h("section", { class: "card stage", "aria-label": t("the robot") }, choice, this.legend, this.flat.canvas, this.space?.canvas ?? null);
        const panel = h("div", { class: "panel table" },
            h("section", { class: "card" }, this.answer, this.place, this.told, this.acts, this.mission, h("div", { class: "bar", "aria-hidden": true }, this.progress)),
            h("section", { class: "card" }, h("h2", {}, t("Go to a point")), h("div", { class: "fields" }, ...this.fields.map((field, i) => h("label", {}, `${"xyz"[i]}, m`, field))),
                h("label", {}, t("height"), this.heightSlider), this.finding, h("div", { class: "row" }, this.go, h("button", { class: "button", type: "button", click: () => this.aim(null) }, t("Clear")))),
            h("section", { class: "card" }, h("h2", {}, t("Move while held")), this.pad, this.cables));
        this.element = h("div", { class: "view fly" }, stage, panel);
        this.acts.addEventListener("click", (event) => { if (this.areNew && !(event.target as Element).closest("[data-stops]")) event.stopPropagation(); }, { capture: true });
        this.show(this.look);
        for (const [name, words, along] of DIRECTIONS) this.pad.append(this.heldButton(name, words, (held) => this.along(along, held)));
        if ("getGamepads" in navigator) this.watchSticks();
        for (const event of ["blur", "pagehide"]) window.addEventListener(event, () => conversation.release());
        document.addEventListener("visibilitychange", () => { if (document.hidden) conversation.release(); });
    }

    /** The sticks of a gamepad move the node while they are held: the left one level, the right one up and down. */
    private watchSticks(): void {
        let steered = "";
        setInterval(() => {
            const axes = navigator.getGamepads().find((pad) => pad?.connected)?.axes ?? [];
            // Forward and up are negative on a gamepad.
            const stick = [axes[0] ?? 0, -(axes[1] ?? 0), -(axes[3] ?? 0)].map((value) => (Math.abs(value) < RESTS ? 0 : Math.sign(value))) as Point;
            const wanted = this.store.flies && !this.element.hidden && !document.hidden ? stick.join() : "0,0,0";
            if (wanted === steered) return;
            const begins = wanted !== "0,0,0";
            if (steered !== "" && steered !== "0,0,0") this.conversation.release();
            steered = wanted;
            if (!begins) return;
            const norm = Math.hypot(...stick);
            void this.along(stick.map((value) => value / norm) as Point, () => steered === wanted);
        }, STICK_MS);
    }

    private show(look: string): void {
        this.look = look;
        for (const [name, button] of Object.entries(this.looks)) button.setAttribute("aria-pressed", String(name === look));
        if (this.space) this.space.canvas.hidden = look !== "3-D";
        this.flat.canvas.hidden = look === "3-D";
        this.flat.side = look === "Side" ? "side" : "top";
    }

    /** Shows the answer to a request. */
    said(answer: Answer): void {
        this.answer.hidden = false;
        this.answer.classList.toggle("refused", answer.accepted !== "accepted");
        write(this.answer, told(answer));
    }

    private async ask(request: Request): Promise<void> { this.said(await this.conversation.ask(request)); }

    /** Sets coordinates of the target; null removes it. */
    private aim(at: Partial<Record<0 | 1 | 2, number>> | null): void {
        const now = this.drawn.target?.at ?? nodeOf(this.store.state) ?? this.middle();
        if (!at || Object.values(at).some((value) => !Number.isFinite(value))) this.drawn.target = null;
        else {
            const rounded = (axis: 0 | 1 | 2) => Math.round((at[axis] ?? now[axis]) * 100) / 100;
            this.drawn.target = { at: [rounded(0), this.store.scene?.planar ? 0 : rounded(1), rounded(2)], possible: null };
        }
        this.go.disabled = true;
        const target = this.drawn.target;
        this.fields.forEach((field, axis) => { field.value = target ? target.at[axis as 0].toFixed(2) : ""; });
        if (target) this.heightSlider.value = String(target.at[2]);
        this.finding.className = "soft";
        write(this.finding, target ? t("checking …") : t("Tap a point in the drawing, or enter one."));
        clearTimeout(this.checking);
        if (target) this.checking = window.setTimeout(() => void this.check(target), SETTLED_MS);
    }

    private middle(): Point {
        if (!this.store.scene) return [0, 0, 0];
        const [low, high] = bounds(this.store.scene);
        return [(low[0] + high[0]) / 2, (low[1] + high[1]) / 2, low[2] + 0.3 * (high[2] - low[2])];
    }

    private async check(target: NonNullable<Drawn["target"]>): Promise<void> {
        const reply = await this.conversation.call({ call: "check", to_m: target.at });
        if (this.drawn.target !== target) return;
        const possible = reply.reply === "check" && reply.possible;
        target.possible = possible;
        this.finding.className = possible ? "good" : "bad";
        const finding = "sentence" in reply ? translate(reply.sentence) : t("the check gave no finding");
        write(this.finding, `${possible ? "✓" : "✕"} ${finding.charAt(0).toUpperCase()}${finding.slice(1)}.`);
    }

    private fly(): void {
        const target = this.drawn.target;
        if (!target?.possible) return;
        const request: Request = { verb: "goto", to_m: target.at, path: { shape: "line" }, speed_m_s: null };
        const press = this.conversation.press();
        void this.conversation.whenAtRest(press, () => this.conversation.ask(request, press)).then((answer) => this.said(answer));
    }

    /** A move by direction, as far as the ground and the planner permit, while `held`. */
    private async along(direction: Point, held: () => boolean): Promise<void> {
        const at = nodeOf(this.store.state), ground = this.store.scene?.ground_m ?? 0;
        const press = this.conversation.press();
        let answer = refused(t("the position of the node is not known: zero it first"));
        for (const reach of at ? REACHES_M : []) {
            const to = at!.map((value, axis) => value + reach * direction[axis as 0]) as Point;
            to[2] = Math.max(to[2], Math.min(at![2], ground + 0.1));
            answer = await this.conversation.whenAtRest(press, () => this.conversation.held({ verb: "goto", to_m: to, path: { shape: "line" }, speed_m_s: SLOW_M_S }, press), held);
            if (answer.accepted === "accepted" || !held() || press.isOver()) return;
        }
        this.said(answer);
    }

    /** A jog of a cable, as far as its limits permit, while `held`. */
    private async jog(cable: number, sign: number, held: () => boolean): Promise<void> {
        const press = this.conversation.press();
        let answer = refused("");
        for (const reach of REACHES_M) {
            answer = await this.conversation.held({ verb: "jog", cable, distance_m: sign * reach }, press);
            if (answer.accepted === "accepted" || !held() || press.isOver()) return;
        }
        this.said(answer);
    }

    /** A button whose motion ends when it is released. */
    private heldButton(name: string, words: string, move: (held: () => boolean) => Promise<void>): HTMLButtonElement {
        const button = h("button", { class: "button hold", type: "button", "aria-label": t("{what}, while held", { what: words }) }, name);
        const begin = () => {
            button.classList.add("held");
            void move(() => button.classList.contains("held"));
        };
        const end = () => {
            if (!button.classList.contains("held")) return;
            button.classList.remove("held");
            this.conversation.release();
        };
        button.addEventListener("pointerdown", (event) => { button.setPointerCapture(event.pointerId); begin(); });
        for (const event of ["pointerup", "pointercancel", "lostpointercapture", "blur"]) button.addEventListener(event, end);
        // Turning a phone moves the button from under the finger, and the drawing with it.
        UPRIGHT.addEventListener("change", end);
        button.addEventListener("keydown", (event) => { if (event.key === "Enter" && !event.repeat) begin(); });
        button.addEventListener("keyup", (event) => { if (event.key === "Enter") end(); });
        button.addEventListener("contextmenu", (event) => event.preventDefault());
        return button;
    }

    private action(name: string, request: Request, main = false): HTMLButtonElement {
        return h("button", { class: main ? "button main wide" : "button", type: "button", "data-stops": request.verb === "pause", click: () => void this.ask(request) }, name);
    }

    /** The actions of the mode, the one that leads on first. */
    private actions(): HTMLElement[] {
        const { state } = this.store, rest = [h("button", { class: "button", type: "button", click: () => void this.disarm() }, t("Disarm"))];
        if (!this.store.flies) return [];
        const doing = isActive(state?.mission) ? state?.mission?.state : null;
        switch (state?.mode) {
            case "disarmed": return [this.action(t("Arm"), { verb: "arm" }, true)];
            case "faulted":
            case "emergency stop": return [this.action(t("Reset"), { verb: "reset" }, true), ...rest];
            case "holding": {
                const paused = doing === "paused" || (state.rate_target === 0 && doing === "running");
                const first = paused ? [this.action(t("Resume"), { verb: "resume" }, true)] : [];
                const confirm = state.position_known === 1 ? [this.action(t("The position is right"), { verb: "confirm-position" }, true)] : [];
                const zero = h("button", { class: state.position_known ? "button" : "button main wide", type: "button", click: () => void this.zero() }, t("The node is at …"));
                return [...first, ...confirm, zero, ...rest];
            }
            case "following": return [this.action(t("Pause"), { verb: "pause" }, true), ...[25, 50, 100].map((percent) => this.action(`${percent} %`, { verb: "speed", rate: percent / 100 }))];
            case "stopping": return doing === "paused" ? [this.action(t("Resume"), { verb: "resume" }, true)] : [];
            default: return [];
        }
    }

    private get areNew(): boolean { return performance.now() - this.actsAt < RENEWED_MS; }

    private async disarm(): Promise<void> {
        if (await question(t("Switch the drives off? They no longer hold the cables then."))) await this.ask({ verb: "disarm" });
    }

    private async zero(): Promise<void> {
        const target = this.drawn.target?.at;
        if (!target) { this.said(refused(t("enter where the node is below first, or tap there: the button then sets it"))); return; }
        if (await question(t("Set that the node is now at {place} m?", { place: target.map((m) => metres(m)).join(", ") }))) await this.ask({ verb: "zero-at", position_m: target });
    }

    /** Draws what has changed; `visible`: whether this view is shown. */
    draw(visible: boolean): void {
        const { state, scene } = this.store;
        extend(this.drawn.trail, nodeOf(state));
        if (!visible) return;
        if (this.look === "3-D") this.space?.draw();
        else this.flat.draw();
        const at = nodeOf(state);
        write(this.place, at ? `${at.map((m) => metres(m, 3)).join("  ")} m` : t("position not known"));
        const faults = state?.faults ?? [], needs = state?.position_known === 2 || !state?.position ? [] : [state.position];
        renew(this.told, [...faults, ...needs].join("\n"), () => [...faults.map((fault) => h("p", { class: "bad" }, translate(fault))), ...needs.map((need) => h("p", { class: "warn" }, translate(need)))]);
        renew(this.acts, [state?.mode, state?.mission?.state, state?.mission?.silent_s == null, state?.position_known, state?.rate_target === 0, this.store.flies].join(), () => {
            this.actsAt = performance.now();
            return this.actions();
        });
        this.acts.classList.toggle("new", this.areNew);
        const mission = state?.mission, active = isActive(mission);
        write(this.mission, !mission || mission.state === "idle" ? "" : `${missionText(mission)}${!active && mission.reason ? `. ${sentence(mission.reason_code, mission.reason)}` : ""}`);
        this.progress.style.width = `${100 * (active ? mission?.progress ?? 0 : 0)}%`;
        this.go.disabled = !(this.drawn.target?.possible && this.store.flies);
        for (const button of this.pad.children) (button as HTMLButtonElement).disabled = !this.store.flies;
        if (!scene) return;
        const [low, high] = bounds(scene);
        this.heightSlider.min = String(low[2]);
        this.heightSlider.max = String(high[2]);
        const limits = scene.tension_limits_n;
        renew(this.legend, limits.join(), () => [t("tension"), h("i"), h("span", {}, `${limits[0]}`, h("span", {}, `${limits[1]} N`))]);
        renew(this.cables, `${scene.anchors_m.length} ${this.store.flies}`, () => scene.anchors_m.map((_, i) => this.cable(i)));
        this.cables.querySelectorAll(".cable").forEach((row, i) => {
            const tension = state?.tensions_n?.[i], slack = state?.slack?.[i] === 1;
            (row.querySelector("meter") as HTMLMeterElement).value = tension ?? 0;
            write(row.querySelector("span")!, slack ? t("slack") : tension == null ? "–" : `${tension.toFixed(1)} N`);
        });
    }

    private cable(i: number): HTMLElement {
        const [least, most] = this.store.scene?.tension_limits_n ?? [0, 1];
        const out = this.heldButton(t("Out"), t("cable {n}: pay out", { n: i + 1 }), (held) => this.jog(i + 1, 1, held)), reel = this.heldButton(t("In"), t("cable {n}: reel in", { n: i + 1 }), (held) => this.jog(i + 1, -1, held));
        out.disabled = reel.disabled = !this.store.flies;
        return h("div", { class: "cable" }, h("b", {}, String(i + 1)), h("div", {}, h("meter", { min: 0, max: most, low: least, high: 0.8 * most, optimum: (least + most) / 2, "aria-label": t("tension of cable {n}", { n: i + 1 }) }), h("span", {}, "–")), reel, out);
    }
}

/** Whether the screen is upright. */
const UPRIGHT = matchMedia("(orientation: portrait)");
/** A refusal of the page itself. */
const refused = (sentence: string): Answer => ({ reply: "answer", id: 0, accepted: "refused", reason: 0, sentence });
