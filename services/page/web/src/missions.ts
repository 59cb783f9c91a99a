// Missions that this browser keeps: made by a form, drawn, flown.

import { h, renew, write } from "./dom.js";
import { question } from "./question.js";
import type { Conversation, Store } from "./link.js";
import { FlatMap } from "./map.js";
import type { Answer, Point, Request } from "./protocol.js";
import { type Drawn, isActive, missionText, nodeOf } from "./view.js";
import { sentence, t, translate } from "./lang.js";

interface Kept { name: string; text: string }

const KEPT = "nims-missions";
/** Time without a change after which a mission is checked, ms, and the largest number of points that are checked. */
const SETTLED_MS = 400, MOST_CHECKED = 60;
const RASTER = [t("from x, m"), t("from y, m"), t("to x, m"), t("to y, m"), t("height, m"), t("strip, m")];

export class Missions {
    readonly element: HTMLElement;
    private kept: Kept[] = JSON.parse(localStorage.getItem(KEPT) ?? "[]") as Kept[];
    private readonly list = h("div", { class: "table" });
    private readonly name = h("input", { type: "text", value: "field", maxlength: 32, "aria-label": t("name of the mission") });
    private readonly text = h("textarea", { spellcheck: false, "aria-label": t("the mission as text"), input: () => this.preview() });
    private readonly raster = RASTER.map((name) => h("input", { inputmode: "decimal", "aria-label": name }));
    private readonly height = h("input", { inputmode: "decimal", value: "0.8", "aria-label": t("height of tapped points, m") });
    /** The form of a raster and the height of tapped points, which planar robots do not have. */
    private readonly area = h("div", { class: "table" });
    private readonly level = h("label", {}, t("height, m"), this.height);
    private tapped: Point[] = [];
    private readonly map: FlatMap;
    private readonly answer = h("p", { class: "answer", role: "status", hidden: true });
    private readonly finding = h("p", { class: "soft", role: "status" });
    private checking = 0;
    private readonly now = h("p", { class: "big" });
    private readonly reason = h("p", { class: "soft" });
    private readonly acts = h("div", { class: "row" });
    private readonly flights: HTMLButtonElement[];

    constructor(private readonly store: Store, private readonly conversation: Conversation, private readonly drawn: Drawn) {
        const button = (name: string, act: () => void, main = false) => h("button", { class: main ? "button main" : "button", type: "button", click: act }, name);
        this.map = new FlatMap(store, drawn, (at) => this.add(at));
        this.area.append(h("h2", {}, t("A raster over a rectangle")), h("div", { class: "fields" }, ...this.raster.map((field, i) => h("label", {}, RASTER[i]!, field))),
            h("div", { class: "row" }, button(t("Around the node"), () => this.suggest()), button(t("Write it"), () => this.write(), true)));
        this.flights = [button(t("Fly it"), () => void this.fly(false), true), button(t("Fly the rest"), () => void this.fly(true))];
        this.element = h("div", { class: "view" },
            h("section", { class: "card" }, this.answer, this.now, this.reason, this.acts),
            h("div", { class: "columns table" },
                h("section", { class: "card" }, this.area,
                    h("h2", {}, t("Or straight lines: tap one point after the other")),
                    h("div", { class: "stage" }, this.map.canvas),
                    h("div", { class: "row" }, this.level, button(t("Take the last one back"), () => this.undo()))),
                h("section", { class: "card" }, h("label", {}, t("name"), this.name), h("label", {}, t("the mission as text: name, speed_m_s, and one [[leg]] after the other"), this.text),
                    this.finding, h("div", { class: "row" }, ...this.flights, button(t("Keep"), () => this.keep())),
                    h("h2", {}, t("Kept in this browser")), this.list)));
        this.rows();
        this.preview();
    }

    /** Adds a tapped point: at the height that is entered, or of a planar robot where it was tapped in the view from the side. */
    private add(at: Partial<Record<0 | 1 | 2, number>>): void {
        const height = Number(this.height.value.replace(",", ".")), [x, y, z] = this.store.scene?.planar ? [at[0], 0, at[2]] : [at[0], at[1], height];
        if (x === undefined || y === undefined || z === undefined || !Number.isFinite(z)) return;
        this.tapped.push([x, y, z].map((value) => Math.round(value * 100) / 100) as Point);
        this.lines();
    }

    private undo(): void { this.tapped.pop(); this.lines(); }

    private lines(): void {
        const points = this.tapped.map((point) => `[${point.join(", ")}]`).join(", ");
        this.text.value = this.tapped.length ? `name = "${this.name.value}"\n\n[[leg]]\npolyline = { points_m = [${points}] }\n` : "";
        this.preview();
    }

    private said(answer: Answer): void {
        this.answer.hidden = false;
        this.answer.classList.toggle("refused", answer.accepted !== "accepted");
        write(this.answer, `${answer.accepted === "accepted" ? "✓" : "✕"} ${sentence(answer.reason, answer.sentence)}`);
    }

    private suggest(): void {
        const at = nodeOf(this.store.state);
        if (!at) { this.said({ reply: "answer", id: 0, accepted: "refused", reason: 0, sentence: t("the position of the node is not known: zero it in the view Fly first") }); return; }
        [at[0] - 0.6, at[1] - 0.4, at[0] + 0.6, at[1] + 0.4, Math.max(at[2], 0.5), 0.25].forEach((value, i) => { this.raster[i]!.value = value.toFixed(2); });
        this.write();
    }

    private write(): void {
        const [x0, y0, x1, y1, z, pitch] = this.raster.map((field) => Number(field.value.replace(",", ".")));
        this.text.value = `name = "${this.name.value}"\n\n[[leg]]\nraster = { corner_m = [${x0}, ${y0}, ${z}], opposite_m = [${x1}, ${y1}, ${z}], pitch_m = ${pitch} }\n`;
        this.preview();
    }

    /** Draws the tracks of a raster that was written here, and the points of any other mission. */
    private preview(): void {
        const at = nodeOf(this.store.state), text = this.text.value.replace(/#.*$/gm, "");
        // Relative points begin where the mission does: where the node is now.
        const isRelative = /^\s*relative\s*=\s*true\b/m.test(text), from_m = isRelative ? at : [0, 0, 0] as Point;
        const points = from_m === null ? [] : [...text.matchAll(/\[\s*(-?[\d.]+)\s*,\s*(-?[\d.]+)\s*,\s*(-?[\d.]+)\s*\]/g)].map((found) => [1, 2, 3].map((i) => Number(found[i]) + from_m[i - 1]!) as Point);
        const pitch = Number(/pitch_m\s*=\s*([\d.]+)/.exec(text)?.[1]);
        const [from, to] = points;
        const drawn = /raster/.test(text) && points.length === 2 && from && to && pitch > 0 && from[2] === to[2] ? tracks(from, to, pitch) : points;
        this.drawn.preview = drawn.length && at ? [at, ...drawn] : drawn;
        clearTimeout(this.checking);
        this.finding.className = "soft";
        write(this.finding, drawn.length ? t("checking …") : from_m === null ? t("the position of the node is not known: zero it in the view Fly first") : t("The points of a mission are drawn and checked here; the planner checks all of it before it flies."));
        if (drawn.length) this.checking = window.setTimeout(() => void this.check(drawn), SETTLED_MS);
    }

    /** Checks whether the node can hang at each point. */
    private async check(points: Point[]): Promise<void> {
        const some = points.slice(0, MOST_CHECKED), before = this.drawn.preview;
        for (const to_m of some) {
            const reply = await this.conversation.call({ call: "check", to_m });
            if (this.drawn.preview !== before) return;
            if (reply.reply === "check" && reply.possible) continue;
            this.finding.className = "bad";
            write(this.finding, `✕ ${"sentence" in reply ? translate(reply.sentence) : t("the check gave no finding")}`);
            return;
        }
        this.finding.className = "good";
        write(this.finding, `✓ ${some.length === points.length ? t("The node can hang at each of {n} points; the planner checks the way before it flies.", { n: some.length }) : t("The node can hang at the first {n} points; the planner checks the way before it flies.", { n: some.length })}`);
    }

    private keep(): void {
        this.kept = [...this.kept.filter((one) => one.name !== this.name.value), { name: this.name.value, text: this.text.value }];
        localStorage.setItem(KEPT, JSON.stringify(this.kept));
        this.rows();
    }

    private rows(): void {
        const load = (one: Kept) => { this.name.value = one.name; this.text.value = one.text; this.preview(); };
        const remove = async (one: Kept) => {
            if (!await question(t("Delete the mission {name} from this browser?", { name: one.name }))) return;
            this.kept = this.kept.filter((other) => other !== one);
            localStorage.setItem(KEPT, JSON.stringify(this.kept));
            this.rows();
        };
        this.list.replaceChildren(...(this.kept.length ? this.kept.map((one) => h("div", { class: "line" }, h("b", {}, one.name), h("div", { class: "row" },
            h("button", { class: "button", type: "button", click: () => load(one) }, t("Open")), h("button", { class: "button", type: "button", click: () => void remove(one) }, t("Delete"))))) : [h("p", { class: "soft" }, t("none yet"))]));
    }

    private async fly(continues: boolean): Promise<void> {
        const reply = await this.conversation.call({ call: "fly", name: this.name.value, text: this.text.value, continues });
        if (reply.reply === "answer") this.said(reply);
        // On a small screen the answer, and with it Pause, is far above the button.
        this.now.scrollIntoView({ block: "center" });
    }

    draw(): void {
        const { state } = this.store, mission = state?.mission;
        const active = isActive(mission);
        write(this.now, !mission || mission.state === "idle" ? t("No mission") : missionText(mission));
        write(this.reason, mission?.reason ? sentence(mission.reason_code, mission.reason) : "");
        const act = (name: string, request: Request) => h("button", { class: "button", type: "button", click: async () => this.said(await this.conversation.ask(request)) }, name);
        const flies = this.store.flies;
        for (const flight of this.flights) flight.disabled = !flies || this.text.value.trim() === "";
        this.area.hidden = this.level.hidden = this.store.scene?.planar === true;
        this.map.side = this.store.scene?.planar ? "side" : "top";
        this.map.draw();
        renew(this.acts, `${active} ${flies}`, () => (active ? [act("Pause", { verb: "pause" }), ...(flies ? [act("Resume", { verb: "resume" }), ...[25, 50, 100].map((percent) => act(`${percent} %`, { verb: "speed", rate: percent / 100 }))] : [])] : []));
    }
}

/** The tracks of a raster, along its longer side. */
function tracks(from: Point, to: Point, pitch: number): Point[] {
    const long = Math.abs(to[0] - from[0]) >= Math.abs(to[1] - from[1]) ? 0 : 1, wide = 1 - long as 0 | 1;
    const width = to[wide] - from[wide], count = Math.min(200, Math.max(1, Math.ceil(Math.abs(width) / pitch)));
    return Array.from({ length: count }, (_, i) => {
        const across = from[wide] + (width * (i + 0.5)) / count, ends = i % 2 ? [to[long], from[long]] : [from[long], to[long]];
        return ends.map((end) => { const point: Point = [0, 0, from[2]]; point[long] = end; point[wide] = across; return point; });
    }).flat();
}
