// The guided calibration: the questions and refusals of `nims setup`, with a drawing for each step and the site from above.

import { h, renew, write } from "./dom.js";
import { drawing, siteDrawing } from "./drawings.js";
import { guided, sentence, t } from "./lang.js";
import type { Conversation, Store } from "./link.js";
import { question } from "./question.js";
import type { Stepped } from "./protocol.js";

/** Where this browser keeps the measurements of its sites, and the name of the one that is open. */
const SITES = "nims-sites", OPEN = "nims-site";
const FIRST = "site";

export class SetUp {
    readonly element: HTMLElement;
    private sites: Record<string, string> = JSON.parse(localStorage.getItem(SITES) ?? "{}") as Record<string, string>;
    private name = localStorage.getItem(OPEN) ?? FIRST;
    private stepped: Stepped | null = null;
    /** Its question in the language of the browser. */
    private asks = "";
    private asked = false;
    private busy = false;
    /** How often a site has been opened: an answer that comes after the next one is not shown. */
    private opened = 0;
    private readonly picture = h("div", { class: "step" });
    private readonly question = h("p", { class: "big question", role: "status" });
    private readonly message = h("p", { class: "answer", role: "status", hidden: true });
    private readonly line = h("input", { type: "text", autocomplete: "off", autocapitalize: "none", spellcheck: "false", maxlength: 200, "aria-label": t("answer") });
    private readonly send = h("button", { class: "button main" }, t("Answer"));
    private readonly acts = h("div", { class: "row" });
    private readonly map = h("div", { class: "site" });
    private readonly known = h("div", { class: "table" });
    private readonly files = h("div", { class: "table" });
    private readonly check = h("button", { class: "button", type: "button", click: () => void this.doctor() }, t("Check the machine"));
    private readonly findings = h("div", { class: "log", role: "status" });
    private readonly list = h("div", { class: "row" });
    private readonly site = h("input", { type: "text", maxlength: 32, autocapitalize: "none", spellcheck: "false", "aria-label": t("name of the site") });

    constructor(private readonly store: Store, private readonly conversation: Conversation) {
        const form = h("form", { class: "row", submit: (event: Event) => { event.preventDefault(); void this.answer(this.line.value); } }, h("label", { class: "wide" }, t("answer"), this.line), this.send);
        const begin = h("form", { class: "row", submit: (event: Event) => { event.preventDefault(); this.open(this.site.value.trim() || FIRST); } }, h("label", { class: "wide" }, t("name of the site"), this.site), h("button", { class: "button" }, t("Open the site")));
        this.element = h("div", { class: "view" }, h("div", { class: "columns table" },
            h("section", { class: "card" }, h("h2", {}, t("Calibrate the site")), this.picture, this.message, this.question, form, this.acts, this.files),
            h("section", { class: "card" }, h("h2", {}, t("How well each pole is known")), this.map, this.known, h("h2", {}, t("Sites in this browser")), this.list, begin),
            h("section", { class: "card" }, h("h2", {}, t("The robot's machine")), this.check, this.findings)));
    }

    private open(name: string): void {
        this.name = name;
        this.opened += 1;
        localStorage.setItem(OPEN, name);
        this.stepped = null;
        this.message.hidden = true;
        this.files.replaceChildren();
        void this.step(null);
    }

    /** What `nims doctor` finds on the robot's machine. */
    private async doctor(): Promise<void> {
        this.check.disabled = true;
        const reply = await this.conversation.call({ call: "doctor" }, 60_000);
        this.check.disabled = false;
        this.findings.replaceChildren(...(reply.reply === "findings"
            ? reply.findings.map(({ level, finding, cure }) => h("p", { class: level }, h("b", {}, `${LEVELS[level] ?? level}: `), finding, cure ? h("span", { class: "soft" }, ` ${t("Cure")}: ${cure}`) : null))
            : [h("p", { class: "error" }, "sentence" in reply ? sentence("reason" in reply ? reply.reason : 0, reply.sentence) : t("no answer"))]));
    }

    private answer(line: string): Promise<void> { return this.step(line); }

    /** Answers the open question; without a line it only asks for it. */
    private async step(line: string | null): Promise<void> {
        if (this.busy) return;
        this.asked = this.busy = this.send.disabled = true;
        const { name, opened } = this, measurements = this.sites[name] ?? "";
        const reply = await this.conversation.call({ call: "setup", name, measurements, line }, 60_000);
        this.busy = this.send.disabled = false;
        // Measurements that were deleted meanwhile stay deleted.
        if (reply.reply === "setup" && reply.changed && (this.sites[name] ?? "") === measurements) this.keep(name, reply.measurements);
        // Another site is open: its question is asked for.
        if (opened !== this.opened) { this.asked = false; return; }
        if (reply.reply !== "setup") {
            // Without a connection it is asked for again.
            this.asked = this.stepped !== null || ("reason" in reply && this.conversation.isOpen);
            this.said("sentence" in reply ? guided(sentence("reason" in reply ? reply.reason : 0, reply.sentence)) : t("no answer"), true);
            return;
        }
        this.stepped = reply;
        this.asks = guided(reply.question);
        // What was typed meanwhile stays.
        if (line !== null && this.line.value === line) this.line.value = "";
        if (reply.message) this.said(guided(reply.message), !reply.changed);
        else this.message.hidden = true;
        if (reply.finished) this.finish(reply.finished);
        else if (reply.changed) this.files.replaceChildren();
        if (line !== null) this.line.focus({ preventScroll: true });
    }

    private keep(name: string, measurements: string): void {
        this.sites = { ...this.sites, [name]: measurements };
        localStorage.setItem(SITES, JSON.stringify(this.sites));
    }

    private said(words: string, refused: boolean): void {
        this.message.hidden = false;
        this.message.classList.toggle("refused", refused);
        write(this.message, words);
    }

    private finish(finished: NonNullable<Stepped["finished"]>): void {
        const offers = [finished.calibration, finished.robot].filter((file) => file !== null);
        const { calibration, robot } = finished, { name } = this;
        const store = h("button", { class: "button main", type: "button", click: async () => {
            if (!robot || !await question(t("Store this calibration in the robot file on the robot? It flies with it from its next start; the robot file of before is kept."))) return;
            store.disabled = true;
            const reply = await this.conversation.call({ call: "robot-file", robot: robot.text, calibration: calibration.text }, 60_000);
            store.disabled = false;
            if (name !== this.name) return;
            this.said("sentence" in reply ? sentence("reason" in reply ? reply.reason : 0, reply.sentence) : t("no answer"), !("accepted" in reply && reply.accepted === "accepted"));
        } }, t("Store it on the robot"));
        this.files.replaceChildren(h("pre", { class: "verdict" }, finished.words),
            ...(robot ? [h("div", { class: "row" }, store), h("p", { class: "soft" }, t("Or take the files: the robot file names the calibration."))] : [h("p", {}, t("In [robot] of the robot file write calibration = '{name}' in place of anchors_m, and run `nims check` there.", { name: calibration.name }))]),
            h("div", { class: "row" }, ...offers.map((file) => offer(file.name, file.text)), offer(`${this.name}.toml`, this.sites[this.name] ?? "")));
    }

    private async remove(name: string): Promise<void> {
        if (!await question(t("Delete the measurements of {name} from this browser?", { name }))) return;
        const { [name]: _, ...rest } = this.sites;
        this.sites = rest;
        localStorage.setItem(SITES, JSON.stringify(rest));
        if (name === this.name) this.open(name);
    }

    draw(): void {
        if (!this.asked && this.conversation.isOpen && this.store.welcome) void this.step(null);
        const { stepped } = this, open = stepped?.open ?? null;
        write(this.question, stepped ? this.asks : (this.store.flies ? "" : t("A site is calibrated by who may fly: pair this browser in the view Robot.")));
        const theme = document.documentElement.dataset.theme ?? "";
        this.question.classList.toggle("long", this.asks.length > 300);
        renew(this.picture, JSON.stringify([open, theme]), () => (open ? [drawing(open)] : []));
        renew(this.map, JSON.stringify([stepped?.map, theme]), () => (stepped ? [siteDrawing(stepped.map)] : []));
        renew(this.known, JSON.stringify([stepped?.map.known, stepped?.map.best]), () => (stepped?.map.known ?? []).map((one, i) => h("p", { class: "soft" }, t("Pole {n}: within {level} mm on the level with 95 %, its height ±{height} mm", { n: i + 1, level: (1000 * one.half_axes_m[0]).toFixed(0), height: (1000 * one.height_std_m).toFixed(0) }))).concat(stepped?.map.best ? [h("p", {}, t("One more point helps most at the cross: it makes the least certain coordinate {share} % more certain.", { share: (100 - (100 * stepped.map.best.worst_std_m[1]) / stepped.map.best.worst_std_m[0]).toFixed(1) }))] : []));
        const kind = open?.kind ?? "", lengths = kind === "lengths" || kind === "confirm";
        renew(this.acts, JSON.stringify([kind, open?.optional, this.store.flies]), () => {
            const act = (name: string, line: string) => h("button", { class: "button", type: "button", click: () => void this.answer(line) }, name);
            if (!open || !this.store.flies) return [];
            return [
                ...(kind === "side" ? [act(t("left"), "l"), act(t("right"), "r")] : []), ...(kind === "decision" ? [act(t("Use it anyway"), "keep"), act(t("Measure it again"), "again")] : []),
                lengths ? act(t("Take the robot's lengths"), "capture") : null, kind === "lengths" ? act(t("No more points"), "done") : null,
                open.optional ? act(EMPTY[kind] ?? t("Leave it out"), "") : null, act(t("Take the last answer back"), "undo"), act(t("Help"), "help"),
            ];
        });
        renew(this.list, JSON.stringify([Object.keys(this.sites), this.name]), () => Object.keys(this.sites).map((name) => h("span", { class: "row" },
            h("button", { class: "button", type: "button", "aria-pressed": String(name === this.name), click: () => this.open(name) }, name), h("button", { class: "button", type: "button", "aria-label": t("Delete {name}", { name }), click: () => void this.remove(name) }, "✕"))));
    }
}

/** The levels of findings. */
const LEVELS: Record<string, string> = { error: t("error"), warning: t("warning"), note: t("note") };
/** What an empty answer means. */
const EMPTY: Record<string, string> = { finish: t("Write the calibration"), confirm: t("It is right"), points: t("As proposed"), radius: t("Eyes, no wheels"), "tape-decision": t("It is right") };

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
