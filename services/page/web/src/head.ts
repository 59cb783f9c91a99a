// The line at the top of every view.

import { bytes, h, write } from "./dom.js";
import type { Conversation, Store } from "./link.js";
import { SeatBar } from "./seat.js";
import { t, translate } from "./lang.js";

/** Age from which the data is old, s. */
const OLD_S = 1;
/** Disk below which the figure is marked, bytes. */
const SCARCE = 2e9;
/** Signs beside the colours of the modes. */
const SIGNS: Record<string, string> = { disarmed: "○", holding: "■", jogging: "▸", soft: "≈", following: "▶", stopping: "▾", faulted: "!", "emergency stop": "✕" };

/** Names of the figures. */
const FACTS: Record<string, string> = { node: t("node"), supply: t("supply"), disk: t("disk"), cycles: t("cycles"), flies: t("flies"), you: t("you") };

/** The mode and the figures by which the robot can be trusted. */
export class Head {
    readonly element: HTMLElement;
    readonly note = h("div", { class: "old-note", role: "alert", hidden: true });
    private readonly mode = h("span", { class: "mode", role: "status" }, "…");
    private readonly facts = new Map<string, { row: HTMLElement; value: HTMLElement }>();

    private readonly seat: SeatBar;

    constructor(private readonly store: Store, conversation: Conversation) {
        const theme = h("button", { class: "theme", type: "button", "aria-label": t("Bright or dark"), click: () => dress(document.documentElement.dataset.theme === "dark" ? "bright" : "dark") }, "◐");
        const facts = Object.keys(FACTS).map((name) => {
            const value = h("b"), row = h("span", { class: "fact" }, FACTS[name] ?? name, value);
            this.facts.set(name, { row, value });
            return row;
        });
        this.seat = new SeatBar(store, conversation);
        this.element = h("header", { class: "head" }, this.mode, ...facts, theme, this.seat.element);
        dress(localStorage.getItem("nims-theme") ?? (matchMedia("(prefers-color-scheme: dark)").matches ? "dark" : "bright"));
    }

    private set(name: string, text: string | null, bad = false, dim = false): void {
        const fact = this.facts.get(name);
        if (!fact) return;
        fact.row.hidden = text === null;
        fact.row.classList.toggle("bad", bad);
        fact.row.classList.toggle("dim", dim);
        write(fact.value, text ?? "");
    }

    draw(): void {
        const { state, robot, scene, seat, welcome, link, trouble } = this.store, mode = state?.mode ?? "unknown";
        this.mode.dataset.mode = mode;
        this.mode.dataset.sign = SIGNS[mode] ?? "?";
        write(this.mode, t(mode));
        this.mode.title = translate(state?.mode_sentence ?? "");
        const within = state?.within_m, unreceived = state?.mode == null || state.located === false;
        if (within == null && unreceived) this.set("node", t("not received yet"), false, true);
        else this.set("node", within == null ? t("not known") : `±${Math.round(within * 1000)} mm`, within == null || within > 0.1);
        this.set("supply", state?.supply_v == null ? null : `${state.supply_v.toFixed(1)} V`, (state?.supply_v ?? 0) < (scene?.supply_min_v ?? 0) + 1);
        const recorder = robot?.recorder, disk = recorder?.disk_free_bytes;
        if (recorder?.problem) this.set("disk", t("NOT RECORDING"), true);
        else if (recorder?.silent_s != null) this.set("disk", t("recorder silent for {s} s", { s: recorder.silent_s }), false, true);
        else this.set("disk", disk != null ? bytes(disk) : link?.run ? t("not received yet") : null, (disk ?? SCARCE) < SCARCE, disk == null);
        const cycle = state?.cycle, missed = cycle?.missed ?? 0;
        this.set("cycles", cycle ? (missed ? t("{n} missed in a minute", { n: missed }) : `${cycle.hz.toFixed(0)} Hz`) : null, missed > 0);
        this.set("flies", seat.flyer ?? robot?.flyer?.name ?? null);
        this.seat.draw();
        this.set("you", welcome ? `${welcome.paired ? `${welcome.user}, ` : ""}${{ look: t("may look and stop"), stop: t("may stop") }[welcome.role] ?? t("may fly")}` : null);
        const age_s = this.store.age_s(), old = !(age_s < OLD_S) || trouble !== null;
        document.body.classList.toggle("old", old);
        this.note.hidden = !old;
        const waited = Number.isFinite(age_s) ? t("The data is {s} s old", { s: age_s < 10 ? age_s.toFixed(1) : Math.round(age_s) }) : t("Nothing has come from the robot");
        const why = trouble ?? link?.sentence ?? (link && link.run === null ? t("no robot runs") : null);
        write(this.note, old ? (why ? `${waited}: ${why}` : waited) : "");
    }
}

function dress(theme: string): void {
    document.documentElement.dataset.theme = theme;
    localStorage.setItem("nims-theme", theme);
}
