// Who flies: one person at a time. Another one asks to take over, and both see it.

import { h, renew } from "./dom.js";
import type { Conversation, Store } from "./link.js";
import { t } from "./lang.js";

export class SeatBar {
    readonly element = h("div", { class: "seat", role: "status", hidden: true });

    constructor(private readonly store: Store, private readonly conversation: Conversation) {}

    private button(name: string, what: "ask" | "give" | "keep", main = false): HTMLButtonElement {
        return h("button", { class: main ? "button main" : "button", type: "button", click: () => void this.conversation.seat(what) }, name);
    }

    draw(): void {
        const { seat, welcome, flies } = this.store, me = welcome?.user ?? "";
        const left_s = Math.max(0, Math.ceil(seat.within_s - (performance.now() - this.store.seatAt) / 1000));
        const shown = flies && seat.flyer !== null && (seat.flyer !== me || seat.asks !== null);
        this.element.hidden = !shown;
        renew(this.element, shown ? JSON.stringify([seat, me, left_s]) : "", () => {
            if (!shown) return [];
            if (seat.flyer === me) return [h("b", {}, t("{who} asks to fly, and does in {s} s", { who: seat.asks ?? "", s: left_s })), this.button(t("Give"), "give"), this.button(t("Keep"), "keep", true)];
            if (seat.asks === me) return [h("b", {}, t("{who} is asked; you fly in {s} s", { who: seat.flyer ?? "", s: left_s })), this.button(t("Do not ask"), "keep")];
            return [h("b", {}, seat.asks === null ? t("{who} flies", { who: seat.flyer ?? "" }) : t("{who} flies, and {other} asks to", { who: seat.flyer ?? "", other: seat.asks })), seat.asks === null ? this.button(t("Ask to fly"), "ask") : null];
        });
    }
}
