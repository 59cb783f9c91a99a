// The last ten minutes: what the server kept before this page was opened, and what has come since; any number of any channel.

import uPlot from "uplot";
import { h, renew } from "./dom.js";
import type { Conversation, Store } from "./link.js";
import { MARKS, type Mark, drawMarks, marks } from "./marks.js";
import { Numbers } from "./numbers.js";
import type { Figures } from "./protocol.js";
import { colours } from "./view.js";
import { t } from "./lang.js";

/** Length of the charts, and time between two points, s. */
const LENGTH_S = 600, STEP_S = 0.5;
/** Height of a chart, px. */
const HEIGHT = 230;
/** Lines that colour-blind people tell apart (Okabe and Ito), darker where the ground is bright. */
export const LINES = { bright: ["#0b5cad", "#b85c00", "#00664f", "#9c2f7d", "#6b5d00", "#444444", "#0089a8", "#b3001b"], dark: ["#7cc0ff", "#ffb000", "#5fd6b0", "#f08bd0", "#f0e442", "#cccccc", "#56d6f0", "#ff8d8d"] };

interface Row { at_s: number; figures: Figures }
interface Chart { name: string; unit: string; lines: (cables: number) => string[]; values: (figures: Figures) => (number | null)[] }

const CABLES = (cables: number) => Array.from({ length: cables }, (_, i) => `cable ${i + 1}`);
const CHARTS: Chart[] = [
    { name: t("Position"), unit: "m", lines: () => ["x", "y", "z"], values: (figures) => figures.position_m },
    { name: t("Tensions"), unit: "N", lines: CABLES, values: (figures) => figures.tensions_n },
    { name: t("Currents"), unit: "A", lines: CABLES, values: (figures) => figures.currents_a },
    { name: t("Uncertainty of the position"), unit: "mm", lines: () => [t("within")], values: ({ within_m }) => [within_m == null ? null : within_m * 1000] },
    { name: t("Supply"), unit: "V", lines: () => [t("lowest unit")], values: (figures) => [figures.supply_v] },
];

/** Seconds of this browser's clock, which the charts use. */
const now_s = () => Date.now() / 1000;

export class Charts {
    readonly element = h("div", { class: "view" });
    private rows: Row[] = [];
    private taken: object | null = null;
    private drawnAt = 0;
    private built = "";
    private plots: { chart: Chart; plot: uPlot; count: number }[] = [];

    private readonly own: Numbers;
    private readonly fixed = h("div", { class: "columns table" });
    private readonly told = h("div", { class: "log" });

    constructor(private readonly store: Store, conversation: Conversation) {
        this.own = new Numbers(store, conversation);
        this.element.append(h("p", { class: "soft legend-line" }, ...Object.entries(MARKS).map(([kind, words]) => h("span", { class: `mark of-${kind}` }, words))), this.own.element, this.fixed, h("section", { class: "card" }, h("h2", {}, t("What happened in these minutes")), this.told));
        this.fixed.append(h("section", { class: "card" }, h("p", { class: "soft" }, t("Nothing has come from the robot yet."))));
    }

    /** Keeps what has come, also while another view is shown. */
    private keep(): void {
        const { history, state } = this.store;
        if (history && history !== this.taken) {
            this.taken = history;
            this.rows = history.rows.map(([age_s, figures]) => ({ at_s: now_s() - age_s, figures }));
        }
        const last = this.rows[this.rows.length - 1], at_s = now_s();
        if (!state?.mode || this.store.age_s() > 1 || (last && at_s < last.at_s + STEP_S)) return;
        this.rows.push({ at_s, figures: { mode: state.mode, position_m: state.position_m ?? [], within_m: state.within_m ?? null, tensions_n: state.tensions_n ?? [], currents_a: state.currents_a ?? [], supply_v: state.supply_v ?? null } });
        while (this.rows.length > 0 && this.rows[0]!.at_s < at_s - LENGTH_S) this.rows.shift();
    }

    /** What is marked: changes of the mode, and events. */
    private get marks(): Mark[] {
        const modes = this.rows.flatMap(({ at_s, figures: { mode } }, i) => {
            const before = this.rows[i - 1]?.figures.mode;
            return before === undefined || before === mode || mode === null ? [] : [{ at_s, kind: ["faulted", "emergency stop"].includes(mode) ? "fault" as const : "mode" as const, words: mode }];
        });
        return [...modes, ...marks(this.store)].filter(({ at_s }) => at_s > now_s() - LENGTH_S).sort((a, b) => a.at_s - b.at_s);
    }

    draw(visible: boolean): void {
        this.keep();
        this.own.draw(visible, () => this.marks);
        const all = visible ? this.marks : [];
        if (visible) renew(this.told, JSON.stringify(all.map(({ at_s, words }) => [Math.round(at_s), words])), () => (all.length ? all.toReversed().map(({ at_s, kind, words }) => h("p", { class: `of-${kind}` }, h("b", {}, new Date(1000 * at_s).toLocaleTimeString("en-GB")), ` ${words}`)) : [h("p", { class: "soft" }, t("nothing yet"))]));
        const cables = this.store.scene?.anchors_m.length ?? 0;
        if (!visible || this.rows.length < 2 || cables === 0 || performance.now() - this.drawnAt < 1000 * STEP_S) return;
        this.drawnAt = performance.now();
        const key = `${cables} ${document.documentElement.dataset.theme}`;
        if (key !== this.built) this.build(cables, key);
        const times = this.rows.map((row) => row.at_s), end = now_s();
        for (const { chart, plot, count } of this.plots) {
            const values = this.rows.map((row) => chart.values(row.figures));
            plot.setData([times, ...Array.from({ length: count }, (_, i) => values.map((row) => row[i] ?? null))], false);
            plot.setScale("x", { min: Math.max(times[0]!, end - LENGTH_S), max: end });
        }
    }

    private build(cables: number, key: string): void {
        this.built = key;
        for (const { plot } of this.plots) plot.destroy();
        const c = colours(), lines = LINES[document.documentElement.dataset.theme === "dark" ? "dark" : "bright"];
        const axis: uPlot.Axis = { stroke: c.ink, grid: { stroke: c.faint, width: 0.5 }, ticks: { stroke: c.faint, width: 0.5 }, font: "13px system-ui, sans-serif" };
        const cards: HTMLElement[] = [];
        this.plots = CHARTS.map((chart) => {
            const names = chart.lines(cables), place = h("div", { class: "chart" });
            const plot = new uPlot({
                width: 300, height: HEIGHT, cursor: { drag: { x: false, y: false } }, scales: { x: { time: true } },
                series: [{ value: "{HH}:{mm}:{ss}" }, ...names.map((label, i) => ({ label, stroke: lines[i % lines.length]!, width: 2, points: { show: false }, spanGaps: false, value: (_: uPlot, value: number | null) => (value == null ? "–" : `${+value.toFixed(3)} ${chart.unit}`) }))],
                axes: [{ ...axis, space: 80, values: (_, times) => times.map((time) => new Date(time * 1000).toLocaleTimeString("en-GB")) }, { ...axis, size: 56 }],
                hooks: { draw: [(plot) => drawMarks(plot, this.marks)] },
            }, undefined, place);
            new ResizeObserver(([entry]) => {
                const width = Math.floor(entry?.contentRect.width ?? 0);
                if (width > 0 && plot.width !== width) plot.setSize({ width, height: HEIGHT });
            }).observe(place);
            cards.push(h("section", { class: "card" }, h("h2", {}, `${chart.name}, ${chart.unit}`), place));
            return { chart, plot, count: names.length };
        });
        this.fixed.replaceChildren(...cards);
    }
}
