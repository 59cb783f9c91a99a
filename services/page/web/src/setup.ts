// Set up: the guided calibration of a site with its plan, the weighing of the node, and the findings about the machine.

import { h, renew } from "./dom.js";
import { siteDrawing } from "./drawings.js";
import { Dialogue } from "./guided.js";
import { sentence, t, translate } from "./lang.js";
import type { Conversation, Store } from "./link.js";
import { question } from "./question.js";
import type { Port, Unit } from "./protocol.js";

/** Where this browser keeps the measurements of its sites, the name of the one that is open, and the measurements with a weight by robot. */
const SITES = "nims-sites", OPEN = "nims-site", LOADS = "nims-loads";
const FIRST = "site";

/** Texts by name that this browser keeps. */
class Kept {
    private texts: Record<string, string>;
    constructor(private readonly key: string) {
        // A browser may have kept a part of it only: the page works without.
        try { this.texts = JSON.parse(localStorage.getItem(key) ?? "{}") as Record<string, string>; } catch { this.texts = {}; }
    }
    get names(): string[] { return Object.keys(this.texts); }
    of(name: string): string { return this.texts[name] ?? ""; }
    put(name: string, text: string): void { this.set({ ...this.texts, [name]: text }); }
    remove(name: string): void { const { [name]: _, ...rest } = this.texts; this.set(rest); }
    private set(texts: Record<string, string>): void { this.texts = texts; localStorage.setItem(this.key, JSON.stringify(texts)); }
}

export class SetUp {
    readonly element: HTMLElement;
    private readonly sites = new Kept(SITES);
    private readonly weighed = new Kept(LOADS);
    private name = localStorage.getItem(OPEN) ?? FIRST;
    private readonly calibrates: Dialogue;
    private readonly weighs: Dialogue;
    private weighing = false;
    /** Since when motions of the robot count for the weighing, ms in time of the server; null before that was pressed. And for which question. */
    private since_ms: number | null = null;
    private sinceFor = "";
    private readonly which = h("div", { class: "row" });
    private readonly asks = h("div", {});
    private readonly map = h("div", { class: "site" });
    private readonly known = h("div", { class: "table" });
    private readonly check = h("button", { class: "button", type: "button", click: () => void this.doctor() }, t("Check the machine"));
    private readonly findings = h("div", { class: "log", role: "status" });
    private readonly drives = h("div", { class: "table" });
    private readonly list = h("div", { class: "row" });
    private readonly site = h("input", { type: "text", maxlength: 32, autocapitalize: "none", spellcheck: "false", "aria-label": t("name of the site") });

    constructor(private readonly store: Store, private readonly conversation: Conversation) {
        const { sites, weighed } = this;
        this.calibrates = new Dialogue(store, conversation, {
            name: () => this.name, kept: (name) => sites.of(name), keep: (name, text) => sites.put(name, text), empty: SITE_EMPTY,
            call: (name, measurements, line) => ({ call: "setup", name, measurements, line }),
            acts: ({ kind }, act) => [
                ...(kind === "side" ? [act(t("left"), "l"), act(t("right"), "r")] : []), ...(kind === "decision" ? [act(t("Use it anyway"), "keep"), act(t("Measure it again"), "again")] : []),
                kind === "lengths" || kind === "confirm" ? act(t("Take the robot's lengths"), "capture") : null, kind === "lengths" ? act(t("No more points"), "done") : null, act(t("Help"), "help"),
            ],
            asks: t("Store this calibration in the robot file on the robot? It flies with it from its next start, `sudo systemctl restart nims@NAME` while it is disarmed; the robot file of before is kept."),
            words: ({ calibration, robot }) => (robot ? t("Or take the files: the robot file names the calibration.") : t("In [robot] of the robot file write calibration = '{name}' in place of anchors_m, and run `nims check` there.", { name: calibration?.name ?? "" })),
            file: () => `${this.name}.toml`,
        });
        this.weighs = new Dialogue(store, conversation, {
            name: () => store.scene?.robot ?? null, kept: (name) => weighed.of(name), keep: (name, text) => weighed.put(name, text), empty: WEIGH_EMPTY,
            call: (_, measurements, line) => ({ call: "weigh", measurements, line, after_ms: this.counted_ms() }),
            acted: () => this.counted_ms() === null,
            acts: ({ kind, weight }, act) => [
                kind === "hang" || kind === "motion" ? act(t("Take the robot's place"), "capture") : null,
                ...(kind === "up" ? [this.counted_ms() === null ? null : act(t("Take the robot's currents"), "watch"), this.begins(weight === true)] : []),
                kind === "renew" ? act(t("More places"), "more") : null,
            ],
            asks: t("Store the stiffness and the weight in the robot file on the robot? It flies with them from its next start, `sudo systemctl restart nims@NAME` while it is disarmed; the robot file of before is kept."),
            words: ({ robot }) => (robot ? t("Or take the file.") : t("Nothing new is determined: the robot file stays as it is.")),
            file: ({ name }) => name ?? "loads.toml",
        });
        const begin = h("form", { class: "row", submit: (event: Event) => { event.preventDefault(); this.open(this.site.value.trim() || FIRST); } }, h("label", { class: "wide" }, t("name of the site"), this.site), h("button", { class: "button" }, t("Open the site")));
        this.element = h("div", { class: "view" }, h("div", { class: "columns table" },
            h("section", { class: "card" }, this.which, this.asks),
            h("section", { class: "card" }, h("h2", {}, t("How well each pole is known")), this.map, this.known, h("h2", {}, t("Sites in this browser")), this.list, begin),
            h("section", { class: "card" }, h("h2", {}, t("The drives")), this.drives),
            h("section", { class: "card" }, h("h2", {}, t("The robot's machine")), this.check, this.findings)));
    }

    /** A button from which on motions count: before it is pressed the node may move without the weight. */
    private begins(weight: boolean): HTMLElement {
        const words = this.since_ms !== null ? t("Begin again") : weight ? t("The weight hangs: begin") : t("No weight hangs: begin");
        return h("button", { class: "button", type: "button", click: () => {
            const { made_ms } = this.store.sign(), isSeen = this.store.age_s() < 1 && Number.isFinite(made_ms);
            this.since_ms = isSeen ? made_ms : null;
            this.weighs.said(isSeen ? t("Motions count from now on.") : t("Nothing has come from the robot"), !isSeen);
        } }, words);
    }

    /** Since when motions count for the question that is open. */
    private counted_ms(): number | null {
        // What was begun is for this question and this run, in the time of this server: another one counts from 0.
        const asked = JSON.stringify([this.weighs.stepped?.open, this.weighs.stepped?.measurements, this.store.link?.run]);
        if (asked !== this.sinceFor || (this.since_ms !== null && this.store.sign().seen_ms < this.since_ms - 2000)) [this.sinceFor, this.since_ms] = [asked, null];
        return this.since_ms;
    }

    private open(name: string): void {
        this.name = name;
        localStorage.setItem(OPEN, name);
        this.weighing = false;
        this.calibrates.restart();
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

    private async remove(name: string): Promise<void> {
        if (!await question(t("Delete the measurements of {name} from this browser?", { name }))) return;
        this.sites.remove(name);
        if (name === this.name) this.open(name);
    }

    draw(): void {
        const now = this.weighing ? this.weighs : this.calibrates;
        now.draw();
        renew(this.which, String(this.weighing), () => [[t("Calibrate the site"), false] as const, [t("Weigh the node"), true] as const].map(([name, weighing]) =>
            h("button", { class: "button", type: "button", "aria-pressed": String(weighing === this.weighing), click: () => { this.weighing = weighing; } }, name)));
        renew(this.asks, String(this.weighing), () => [...(this.weighing ? [h("p", { class: "soft" }, t("A known weight on the node shows how stiff the cables are and how heavy the node is."))] : []), now.element]);
        const map = this.calibrates.stepped?.map ?? null, theme = document.documentElement.dataset.theme ?? "";
        renew(this.map, JSON.stringify([map, theme]), () => (map ? [siteDrawing(map)] : []));
        renew(this.known, JSON.stringify([map?.known, map?.best]), () => (map?.known ?? []).map((one, i) => h("p", { class: "soft" }, t("Pole {n}: within {level} mm on the level with 95 %, its height ±{height} mm", { n: i + 1, level: (1000 * one.half_axes_m[0]).toFixed(0), height: (1000 * one.height_std_m).toFixed(0) }))).concat(map?.best ? [h("p", {}, t("One more point helps most at the cross: it makes the least certain coordinate {share} % more certain.", { share: (100 - (100 * map.best.worst_std_m[1]) / map.best.worst_std_m[0]).toFixed(1) }))] : []));
        const ports = this.store.scene?.drives ?? [], units = this.store.age_s() < 1 ? (this.store.robot?.units ?? null) : null;
        renew(this.drives, JSON.stringify([ports, units]), () => (ports.length ? shownDrives(ports, units) : [h("p", { class: "soft" }, t("no robot runs"))]));
        renew(this.list, JSON.stringify([this.sites.names, this.name]), () => this.sites.names.map((name) => h("span", { class: "row" },
            h("button", { class: "button", type: "button", "aria-pressed": String(name === this.name), click: () => this.open(name) }, name), h("button", { class: "button", type: "button", "aria-label": t("Delete {name}", { name }), click: () => void this.remove(name) }, "✕"))));
    }
}

/** What to set in the drives' programs, and what the drives answer, in the order of the system file. */
function shownDrives(ports: Port[], units: Unit[] | null): HTMLElement[] {
    let index = 0;
    return ports.flatMap((port) => [
        h("p", {}, h("b", {}, t("Port {n}: {family}", { n: port.number, family: port.family })), port.virtual ? ` (${t("virtual, so nothing is to be set")})` : ` ${port.path}`),
        ...port.units.map((unit) => {
            const told = units?.[index++], name = t("unit {address}, cables {cables}", { address: unit.address, cables: unit.cables.join(", ") });
            if (!told) return h("p", { class: "soft" }, `${name}: ${t("not received yet")}`);
            if (!told.answers) return h("p", { class: "error" }, h("b", {}, `${name}: ${t("does not answer")}`), h("span", { class: "soft" }, ` ${t("Cure")}: ${translate(port.silent)}`));
            return h("p", {}, `${name}: `, h("span", { class: "good" }, t("answers")), told.supply_v > 0 ? `, ${told.supply_v.toFixed(1)} V` : "");
        }),
        h("p", { class: "soft" }, `${port.virtual ? t("With real drives, set") : t("Set")} ${translate(port.set)}. ${t("The fastest command is {n} counts per second.", { n: port.fastest_counts_s })}`),
    ]);
}

/** The levels of findings. */
const LEVELS: Record<string, string> = { error: t("error"), warning: t("warning"), note: t("note") };
/** What an empty answer means to the questions about a site, and about a weight. */
const SITE_EMPTY: Record<string, string> = { finish: t("Write the calibration"), confirm: t("It is right"), points: t("As proposed"), radius: t("Eyes, no wheels"), "tape-decision": t("It is right") };
const WEIGH_EMPTY: Record<string, string> = { hang: t("No more places"), motion: t("Do not measure currents"), renew: t("Show what is determined") };
