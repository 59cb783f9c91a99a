// Missions that this browser keeps: made by a form, drawn, flown.

import { h, duration, renew, write } from "./dom.js";
import type { Conversation, Store } from "./link.js";
import type { Answer, Point, Request } from "./protocol.js";
import { type Drawn, nodeOf } from "./view.js";

interface Kept { name: string; text: string }

const KEPT = "nims-missions";
const RASTER = ["from x, m", "from y, m", "to x, m", "to y, m", "height, m", "strip, m"];

export class Missions {
    readonly element: HTMLElement;
    private kept: Kept[] = JSON.parse(localStorage.getItem(KEPT) ?? "[]") as Kept[];
    private readonly list = h("div", { class: "table" });
    private readonly name = h("input", { type: "text", value: "field", maxlength: 32, "aria-label": "name of the mission" });
    private readonly text = h("textarea", { spellcheck: false, "aria-label": "the mission as text", input: () => this.preview() });
    private readonly raster = RASTER.map((name) => h("input", { inputmode: "decimal", "aria-label": name }));
    private readonly answer = h("p", { class: "answer", role: "status", hidden: true });
    private readonly now = h("p", { class: "big" });
    private readonly reason = h("p", { class: "soft" });
    private readonly acts = h("div", { class: "row" });

    constructor(private readonly store: Store, private readonly conversation: Conversation, private readonly drawn: Drawn) {
        const button = (name: string, act: () => void, main = false) => h("button", { class: main ? "button main" : "button", type: "button", click: act }, name);
        this.element = h("div", { class: "view" },
            h("section", { class: "card" }, this.answer, this.now, this.reason, this.acts),
            h("div", { class: "columns table" },
                h("section", { class: "card" }, h("h2", {}, "A raster over a rectangle"), h("div", { class: "fields" }, ...this.raster.map((field, i) => h("label", {}, RASTER[i]!, field))),
                    h("div", { class: "row" }, button("Around the node", () => this.suggest()), button("Write it", () => this.write(), true)),
                    h("h2", {}, "Kept in this browser"), this.list),
                h("section", { class: "card" }, h("label", {}, "name", this.name), h("label", {}, "the mission as text: name, speed_m_s, and one [[leg]] after the other", this.text),
                    h("p", { class: "soft" }, "The points of this text are drawn in the view Fly."),
                    h("div", { class: "row" }, button("Keep", () => this.keep()), button("Fly it", () => void this.fly(false), true), button("Fly the rest", () => void this.fly(true))))));
        this.rows();
    }

    private said(answer: Answer): void {
        this.answer.hidden = false;
        this.answer.classList.toggle("refused", answer.accepted !== "accepted");
        write(this.answer, `${answer.accepted === "accepted" ? "✓" : "✕"} ${answer.sentence}`);
    }

    private suggest(): void {
        const at = nodeOf(this.store.state);
        if (!at) return;
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
        const points = [...text.matchAll(/\[\s*(-?[\d.]+)\s*,\s*(-?[\d.]+)\s*,\s*(-?[\d.]+)\s*\]/g)].map((found) => [1, 2, 3].map((i) => Number(found[i])) as Point);
        const pitch = Number(/pitch_m\s*=\s*([\d.]+)/.exec(text)?.[1]);
        const [from, to] = points;
        const drawn = /raster/.test(text) && points.length === 2 && from && to && pitch > 0 && from[2] === to[2] ? tracks(from, to, pitch) : points;
        this.drawn.preview = drawn.length && at ? [at, ...drawn] : drawn;
    }

    private keep(): void {
        this.kept = [...this.kept.filter((one) => one.name !== this.name.value), { name: this.name.value, text: this.text.value }];
        localStorage.setItem(KEPT, JSON.stringify(this.kept));
        this.rows();
    }

    private rows(): void {
        const load = (one: Kept) => { this.name.value = one.name; this.text.value = one.text; this.preview(); };
        const remove = (one: Kept) => {
            if (!confirm(`Delete the mission ${one.name} from this browser?`)) return;
            this.kept = this.kept.filter((other) => other !== one);
            localStorage.setItem(KEPT, JSON.stringify(this.kept));
            this.rows();
        };
        this.list.replaceChildren(...(this.kept.length ? this.kept.map((one) => h("div", { class: "line" }, h("b", {}, one.name), h("div", { class: "row" },
            h("button", { class: "button", type: "button", click: () => load(one) }, "Open"), h("button", { class: "button", type: "button", click: () => remove(one) }, "Delete")))) : [h("p", { class: "soft" }, "none yet")]));
    }

    private async fly(continues: boolean): Promise<void> {
        const reply = await this.conversation.call({ call: "fly", name: this.name.value, text: this.text.value, continues });
        if (reply.reply === "answer") this.said(reply);
    }

    draw(): void {
        const { state } = this.store, mission = state?.mission;
        const active = mission && ["running", "paused", "ready"].includes(mission.state);
        write(this.now, !mission || mission.state === "idle" ? "No mission" : `${mission.name || "move"}: ${mission.state}${active ? `, leg ${mission.leg} of ${mission.legs}, ${Math.round(100 * mission.progress)} %, ${duration(mission.time_left_s ?? 0)} left` : ""}`);
        write(this.reason, mission?.reason ?? "");
        const act = (name: string, request: Request) => h("button", { class: "button", type: "button", click: async () => this.said(await this.conversation.ask(request)) }, name);
        const flies = this.store.flies;
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
