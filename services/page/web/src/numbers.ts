// Charts of any number of any channel, over the last ten minutes, which the server keeps.

import uPlot from "uplot";
import { h } from "./dom.js";
import { t } from "./lang.js";
import type { Conversation, Store } from "./link.js";
import { type Mark, drawMarks } from "./marks.js";
import { colours } from "./view.js";

/** Where this browser keeps the chosen numbers, and how many charts there are at most. */
const CHOSEN = "nims-charts", MOST = 6;
/** Length of a chart, s, and time between two questions, ms. */
const LENGTH_S = 600, ASKED_MS = 1000;
const HEIGHT = 200;

interface Chosen { channel: string; field: string }

class Chart {
    readonly element: HTMLElement;
    private plot: uPlot | null = null;
    private at_ms: number[] = [];
    private values: (number | null)[] = [];
    private asking = false;
    private theme = "";
    private readonly place = h("div", { class: "chart" });
    private readonly said = h("p", { class: "soft", role: "status" }, t("The values are on their way."));

    constructor(readonly chosen: Chosen, private readonly store: Store, private readonly conversation: Conversation, removed: () => void) {
        const name = `${chosen.channel} ${chosen.field}`;
        this.element = h("section", { class: "card" }, h("div", { class: "row" }, h("h2", {}, name), h("button", { class: "button", type: "button", "aria-label": t("Remove the chart {name}", { name }), click: removed }, "✕")), this.said, this.place);
    }

    /** Asks for what is new. */
    async ask(): Promise<void> {
        if (this.asking || !this.conversation.isOpen) return;
        this.asking = true;
        const after_ms = this.at_ms[this.at_ms.length - 1] ?? -1;
        const reply = await this.conversation.call({ call: "series", ...this.chosen, after_ms });
        this.asking = false;
        if (reply.reply !== "series") { this.said.hidden = false; this.said.textContent = "sentence" in reply ? reply.sentence : t("no answer"); return; }
        // The server was started again: its clock begins again.
        if (after_ms > (this.store.state?.at_ms ?? Infinity)) { this.at_ms = []; this.values = []; return; }
        this.at_ms.push(...reply.at_ms);
        this.values.push(...reply.values);
        this.said.hidden = this.values.length > 0;
        const old = this.at_ms.findIndex((at_ms) => at_ms > (this.at_ms[this.at_ms.length - 1] ?? 0) - 1000 * LENGTH_S);
        if (old > 0) { this.at_ms.splice(0, old); this.values.splice(0, old); }
    }

    draw(marks: () => Mark[]): void {
        const theme = document.documentElement.dataset.theme ?? "";
        if (!this.plot || theme !== this.theme) { this.theme = theme; this.build(marks); }
        const times = this.at_ms.map((at_ms) => this.store.at_s(at_ms)), end = Date.now() / 1000;
        if (times.length === 0) return;
        this.plot!.setData([times, this.values], false);
        this.plot!.setScale("x", { min: Math.max(times[0]!, end - LENGTH_S), max: end });
    }

    private build(marks: () => Mark[]): void {
        this.plot?.destroy();
        const c = colours(), axis: uPlot.Axis = { stroke: c.ink, grid: { stroke: c.faint, width: 0.5 }, ticks: { stroke: c.faint, width: 0.5 }, font: "13px system-ui, sans-serif" };
        const plot = new uPlot({
            width: 300, height: HEIGHT, cursor: { drag: { x: false, y: false } }, scales: { x: { time: true } },
            series: [{ value: "{HH}:{mm}:{ss}" }, { label: this.chosen.field, stroke: c.node, width: 2, points: { show: false }, spanGaps: false, value: (_: uPlot, value: number | null) => (value == null ? "–" : String(+value.toPrecision(6))) }],
            axes: [{ ...axis, space: 80, values: (_, times) => times.map((time) => new Date(time * 1000).toLocaleTimeString("en-GB")) }, { ...axis, size: 64 }],
            hooks: { draw: [(plot) => drawMarks(plot, marks())] },
        }, undefined, this.place);
        new ResizeObserver(([entry]) => {
            const width = Math.floor(entry?.contentRect.width ?? 0);
            if (width > 0 && plot.width !== width) plot.setSize({ width, height: HEIGHT });
        }).observe(this.place);
        this.plot = plot;
    }
}

export class Numbers {
    readonly element: HTMLElement;
    private readonly charts = h("div", { class: "columns table" });
    private readonly channel = h("select", { "aria-label": t("channel"), change: () => this.fields() });
    private readonly field = h("select", { "aria-label": t("number") });
    private readonly add = h("button", { class: "button main", type: "button", click: () => this.chose({ channel: this.channel.value, field: this.field.value }) }, t("Draw it"));
    private known: Record<string, string[]> = {};
    private all: Chart[] = [];
    private askedAt = -Infinity;
    private listedAt = -Infinity;

    constructor(private readonly store: Store, private readonly conversation: Conversation) {
        this.element = h("div", { class: "table" }, h("section", { class: "card" }, h("h2", {}, t("Any number of any channel")), h("div", { class: "fields two" }, h("label", {}, t("channel"), this.channel), h("label", {}, t("number"), this.field)), h("div", { class: "row" }, this.add)), this.charts);
        for (const chosen of JSON.parse(localStorage.getItem(CHOSEN) ?? "[]") as Chosen[]) this.begin(chosen);
    }

    private begin(chosen: Chosen): void {
        const chart: Chart = new Chart(chosen, this.store, this.conversation, () => {
            this.all = this.all.filter((one) => one !== chart);
            chart.element.remove();
            this.keep();
        });
        this.all.push(chart);
        this.charts.append(chart.element);
        if (this.all.length > MOST) { this.all.shift()!.element.remove(); }
    }

    private chose(chosen: Chosen): void {
        if (!chosen.field || this.all.some(({ chosen: { channel, field } }) => channel === chosen.channel && field === chosen.field)) return;
        this.begin(chosen);
        this.keep();
        this.askedAt = -Infinity;
    }

    private keep(): void { localStorage.setItem(CHOSEN, JSON.stringify(this.all.map((chart) => chart.chosen))); }

    private fields(): void { this.field.replaceChildren(...(this.known[this.channel.value] ?? []).map((name) => h("option", {}, name))); }

    private async list(): Promise<void> {
        const reply = await this.conversation.call({ call: "fields" });
        if (reply.reply !== "fields" || JSON.stringify(reply.channels) === JSON.stringify(this.known)) return;
        this.known = reply.channels;
        const chosen = this.channel.value;
        this.channel.replaceChildren(...Object.keys(this.known).map((name) => h("option", { selected: name === chosen }, name)));
        this.fields();
    }

    draw(visible: boolean, marks: () => Mark[]): void {
        const now = performance.now();
        if (!visible || !this.conversation.isOpen) return;
        // A list that is open is left alone.
        if (now - this.listedAt > 10 * ASKED_MS && document.activeElement !== this.channel && document.activeElement !== this.field) { this.listedAt = now; void this.list(); }
        if (now - this.askedAt < ASKED_MS) return;
        this.askedAt = now;
        for (const chart of this.all) void chart.ask().then(() => chart.draw(marks));
    }
}
