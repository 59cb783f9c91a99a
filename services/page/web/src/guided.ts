// A guided dialogue of Set up: its open question with a drawing, the answers, and the files at its end. The server asks
// and refuses as `nims setup` does; the browser keeps the measurements.

import { h, renew, write } from "./dom.js";
import { drawing } from "./drawings.js";
import { sentence, t, translate } from "./lang.js";
import type { Conversation, Store } from "./link.js";
import { question } from "./question.js";
import type { Call, Open, Stepped } from "./protocol.js";

/** What one dialogue asks about. */
export interface Subject {
    /** Name of the measurements that are open; null while it is not known. */
    name: () => string | null;
    /** The call that answers the open question, or without a line asks for it. */
    call: (name: string, measurements: string, line: string | null) => Call;
    /** The measurements of a name in this browser; empty without any. */
    kept: (name: string) => string;
    keep: (name: string, measurements: string) => void;
    /** Buttons beside those of every question. */
    /** What these buttons depend on beside the question. */
    acted?: () => unknown;
    acts: (open: Open, act: (name: string, line: string) => HTMLElement) => (HTMLElement | null)[];
    /** What an empty answer means. */
    empty: Record<string, string>;
    /** Asks before the result is stored on the robot. */
    asks: string;
    /** What is said beside the files. */
    words: (finished: NonNullable<Stepped["finished"]>) => string;
    /** The name of the file of the measurements. */
    file: (stepped: Stepped) => string;
}

export class Dialogue {
    readonly element: HTMLElement;
    stepped: Stepped | null = null;
    /** Its question in the language of the browser. */
    private asks = "";
    private asked = false;
    private busy = false;
    /** How often other measurements have been opened: an answer that comes after the next ones is not shown. */
    private opened = 0;
    /** The robot file with which the robot flies: what was made from another one is not offered. */
    private flown: string | null = null;
    private readonly picture = h("div", { class: "step" });
    private readonly question = h("p", { class: "big question", role: "status" });
    private readonly message = h("p", { class: "answer", role: "status", hidden: true });
    private readonly line = h("input", { type: "text", autocomplete: "off", autocapitalize: "none", spellcheck: "false", maxlength: 200, "aria-label": t("answer") });
    private readonly send = h("button", { class: "button main" }, t("Answer"));
    private readonly buttons = h("div", { class: "row" });
    private readonly files = h("div", { class: "table" });

    constructor(private readonly store: Store, private readonly conversation: Conversation, private readonly subject: Subject) {
        const form = h("form", { class: "row", submit: (event: Event) => { event.preventDefault(); void this.step(this.line.value); } }, h("label", { class: "wide" }, t("answer"), this.line), this.send);
        this.element = h("div", { class: "table" }, this.picture, this.message, this.question, form, this.buttons, this.files);
    }

    /** Other measurements are open. */
    restart(): void {
        this.opened += 1;
        this.stepped = null;
        this.message.hidden = true;
        this.files.replaceChildren();
        void this.step(null);
    }

    /** Answers the open question; without a line it only asks for it. */
    private async step(line: string | null): Promise<void> {
        const name = this.subject.name();
        if (this.busy || name === null) return;
        this.asked = this.busy = this.send.disabled = true;
        const { opened, subject } = this, measurements = subject.kept(name);
        const reply = await this.conversation.call(subject.call(name, measurements, line), 60_000);
        this.busy = this.send.disabled = false;
        // Measurements that were deleted meanwhile stay deleted.
        if (reply.reply === "setup" && reply.changed && subject.kept(name) === measurements) subject.keep(name, reply.measurements);
        // Other measurements are open: their question is asked for.
        if (opened !== this.opened) { this.asked = false; return; }
        if (reply.reply !== "setup") {
            // Without a connection it is asked for again.
            this.asked = this.stepped !== null || ("reason" in reply && this.conversation.isOpen);
            this.said("sentence" in reply ? translate(sentence("reason" in reply ? reply.reason : 0, reply.sentence)) : t("no answer"), true);
            return;
        }
        this.stepped = reply;
        this.asks = translate(reply.question);
        // What was typed meanwhile stays.
        if (line !== null && this.line.value === line) this.line.value = "";
        if (reply.message) this.said(translate(reply.message), !reply.changed);
        else this.message.hidden = true;
        if (reply.finished) this.finish(reply, reply.finished);
        else if (reply.changed) this.files.replaceChildren();
        if (line !== null) this.line.focus({ preventScroll: true });
    }

    said(words: string, refused: boolean): void {
        this.message.hidden = false;
        this.message.classList.toggle("refused", refused);
        write(this.message, words);
    }

    private finish(stepped: Stepped, finished: NonNullable<Stepped["finished"]>): void {
        const { calibration, robot } = finished, { opened } = this;
        const offers = [calibration, robot].filter((file) => file !== null);
        const store = h("button", { class: "button main", type: "button", click: async () => {
            if (!robot || !await question(this.subject.asks)) return;
            store.disabled = true;
            const reply = await this.conversation.call({ call: "robot-file", robot: robot.text, calibration: calibration?.text ?? null, made_from: robot.made_from }, 60_000);
            store.disabled = false;
            if (opened !== this.opened) return;
            this.said("sentence" in reply ? sentence("reason" in reply ? reply.reason : 0, reply.sentence) : t("no answer"), !("accepted" in reply && reply.accepted === "accepted"));
        } }, t("Store it on the robot"));
        this.files.replaceChildren(h("pre", { class: "verdict" }, translate(finished.words)),
            ...(robot ? [h("div", { class: "row" }, store)] : []), h("p", { class: "soft" }, this.subject.words(finished)),
            h("div", { class: "row" }, ...offers.map((file) => offer(file.name, file.text)), offer(this.subject.file(stepped), stepped.measurements)));
    }

    draw(): void {
        const flown = this.store.scene?.robot_file ?? null;
        if (flown !== this.flown) {
            this.flown = flown;
            if (this.stepped) this.restart();
        }
        if (!this.asked && this.conversation.isOpen && this.store.welcome) void this.step(null);
        const { stepped, subject } = this, open = stepped?.open ?? null;
        write(this.question, stepped ? this.asks : (this.store.flies ? "" : t("A site is calibrated by who may fly: pair this browser in the view Robot.")));
        this.question.classList.toggle("long", this.asks.length > 300);
        renew(this.picture, JSON.stringify([open, document.documentElement.dataset.theme ?? ""]), () => (open ? [drawing(open)] : []));
        renew(this.buttons, JSON.stringify([open, this.store.flies, subject.acted?.()]), () => {
            const act = (name: string, line: string) => h("button", { class: "button", type: "button", click: () => void this.step(line) }, name);
            if (!open || !this.store.flies) return [];
            return [...subject.acts(open, act), open.optional ? act(subject.empty[open.kind] ?? t("Leave it out"), "") : null, act(t("Take the last answer back"), "undo")];
        });
    }
}

/** A button that downloads a text. */
function offer(name: string, text: string): HTMLElement {
    return h("button", {
        class: "button", type: "button", click: () => {
            const address = URL.createObjectURL(new Blob([text], { type: "application/toml" })), link = h("a", { href: address, download: name });
            document.body.append(link);
            link.click();
            link.remove();
            setTimeout(() => URL.revokeObjectURL(address), 10_000);
        },
    }, name);
}
