// Marks in the charts: faults, changes of the mode, swaps, and what operators did.

import type uPlot from "uplot";
import type { Store } from "./link.js";
import { sentence, t } from "./lang.js";

export type Kind = "fault" | "mode" | "swap" | "request";
export interface Mark { at_s: number; kind: Kind; words: string }

/** The kinds, with their words. */
export const MARKS: Record<Kind, string> = { fault: t("a fault or an emergency stop"), mode: t("another mode"), swap: t("a swap"), request: t("an operator's action") };
/** Their lines, which are told apart without colours too. */
const DASHES: Record<Kind, number[]> = { fault: [], mode: [4, 4], swap: [10, 4], request: [1, 3] };

/** The events as marks. */
export function marks(store: Store): Mark[] {
    return store.events.flatMap((event): Mark[] => {
        const at_s = store.at_s(event.at_ms);
        switch (event.type) {
            case "swap": return [{ at_s, kind: "swap", words: t("{role} {slot} is in charge", { role: event.role, slot: event.slot }) }];
            case "request": return event.accepted ? [{ at_s, kind: "request", words: `${event.who}: ${sentence(event.reason, event.sentence)}` }] : [];
            default: return event.level === "error" ? [{ at_s, kind: "fault", words: `${event.process}: ${event.sentence}` }] : [];
        }
    });
}

/** Draws the marks into a chart. */
export function drawMarks(plot: uPlot, all: Mark[]): void {
    const { ctx: pen, bbox } = plot, style = getComputedStyle(document.documentElement);
    for (const { at_s, kind } of all) {
        const x = plot.valToPos(at_s, "x", true);
        if (x < bbox.left || x > bbox.left + bbox.width) continue;
        pen.save();
        pen.strokeStyle = style.getPropertyValue({ fault: "--bad", mode: "--ink", swap: "--act", request: "--warn" }[kind]).trim();
        pen.globalAlpha = 0.7;
        pen.lineWidth = (window.devicePixelRatio || 1) * (kind === "fault" ? 2 : 1);
        pen.setLineDash(DASHES[kind]);
        pen.beginPath();
        pen.moveTo(x, bbox.top);
        pen.lineTo(x, bbox.top + bbox.height);
        pen.stroke();
        pen.restore();
    }
}
