// The finished runs: their verdicts, their report and maps, their tables to download, and their removal.

import { bytes, duration, h } from "./dom.js";
import type { Conversation, Store } from "./link.js";
import { question } from "./question.js";
import type { FileRow, Reply, RunRow } from "./protocol.js";
import { sentence, t } from "./lang.js";

/** The newest runs whose verdicts are read, and how many more a press shows. */
const SHOWN = 12;
/** Longest wait for files that are made, ms: as long as the gateway itself waits. */
const MAKING_MS = 16 * 60_000;
/** Endings of files that a browser shows. */
const SHOWS = /\.(html|svg|png|txt|toml|json)$/;
/** Names that begin with their date, as `nims-runs-quota` knows the age of a run; of another name it is not known. */
const DATED = /^\d{4}-\d\d-\d\dT/;
const REPORT = "report.html", FIGURES = "report.json", MANIFEST = "manifest.json";

interface Figures { runs?: { verdict?: { grade?: string; sentence?: string }; sensors?: { channel: string; samples: number }[]; recording?: { duration_s?: number | null } }[] }
interface Manifest { started_utc?: string; ended_utc?: string; ended_because?: string }
type What = "report" | "maps" | "csv" | "parquet";

export class Runs {
    readonly element: HTMLElement;
    private readonly list = h("div", { class: "table" });
    private readonly room = h("div", { class: "table" });
    private shown = SHOWN;

    constructor(private readonly store: Store, private readonly conversation: Conversation) {
        this.element = h("div", { class: "view" }, h("section", { class: "card" },
            h("div", { class: "row" }, h("h2", {}, t("Finished runs")), h("button", { class: "button", type: "button", click: () => void this.load() }, t("Look again"))), this.room, this.list));
    }

    /** Asks for the list. */
    async load(): Promise<void> {
        const reply = await this.conversation.call({ call: "runs" });
        if (reply.reply !== "runs") { this.list.replaceChildren(problem(reply, t("no list"))); return; }
        const used = reply.runs.reduce((sum, run) => sum + run.bytes, 0), { disk } = reply;
        this.room.replaceChildren(...(disk ? [
            h("p", {}, t("{n} runs have {used}; the disk has {free} free of {total}", { n: reply.runs.length, used: bytes(used), free: bytes(disk.free), total: bytes(disk.total) })),
            h("meter", { min: 0, max: disk.total, value: disk.total - disk.free, high: 0.9 * disk.total, "aria-label": t("space in use") }),
            h("p", { class: "soft" }, disk.quota ? t("Above {most} of runs the machine deletes the oldest ones.", { most: bytes(disk.quota) }) : t("The machine deletes no runs: the recording stops when the disk is full. Download and delete runs before; a quota is set in /etc/nims/quota.")),
        ] : []), ...this.oldest(reply.runs));
        const runs = reply.runs.toReversed(), rows = runs.slice(0, this.shown).map((run) => new Run(run, this.store, this.conversation, () => void this.load()));
        this.list.replaceChildren(...(rows.length ? rows.map((row) => row.element) : [h("p", { class: "soft" }, t("no finished run yet; a run ends when the robot is switched off, or started again: `sudo systemctl restart nims@NAME`"))]),
            ...(runs.length > this.shown ? [h("button", { class: "button", type: "button", click: () => { this.shown += SHOWN; void this.load(); } }, t("Older runs"))] : []));
        // One after the other: the gateway opens a bounded number of files at once.
        for (const row of rows) await row.read();
    }

    /** Deletes the oldest run after two questions, to make room; their list is sorted by name. */
    private oldest(runs: RunRow[]): HTMLElement[] {
        const dated = runs.filter((run) => DATED.test(run.name)), [run] = dated, said = h("p", { class: "answer refused", role: "status", hidden: true });
        if (!run || dated.length < 2 || !this.store.flies) return [];
        const { name } = run;
        return [h("button", { class: "button", type: "button", click: async () => {
            if (!await question(t("Delete the run {name} with all its files from the robot?", { name }), t("Delete it"))) return;
            if (!await question(t("The run {name} is lost for good. Delete it?", { name }), t("Delete it for good"))) return;
            const reply = await this.conversation.call({ call: "remove", run: name }, MAKING_MS);
            if (reply.reply === "done") { await this.load(); return; }
            said.hidden = false;
            said.textContent = words_of(reply, t("it cannot be deleted"));
        } }, t("Delete the oldest run: {name}, {size}", { name, size: bytes(run.bytes) })), said];
    }
}

/** A run in the list. */
class Run {
    readonly element: HTMLElement;
    private readonly facts = h("span", { class: "soft" });
    private readonly verdict = h("p", {});
    private readonly said = h("p", { class: "answer refused", role: "status", hidden: true });
    private readonly files = h("div", { class: "table" });
    private readonly acts = h("div", { class: "row" });
    private names: string[] = [];

    constructor(private readonly run: RunRow, private readonly store: Store, private readonly conversation: Conversation, private readonly removed: () => void) {
        this.facts.textContent = ` ${bytes(run.bytes)}, ${t("{n} files", { n: run.files })}`;
        this.element = h("div", { class: "run" }, h("p", {}, h("b", {}, run.name), this.facts), this.verdict, this.said, this.acts, this.files);
        this.buttons();
    }

    private buttons(): void {
        const act = (name: string, does: () => void) => h("button", { class: "button", type: "button", click: does }, name);
        const has = (file: string) => this.names.includes(file), { flies } = this.store;
        this.acts.replaceChildren(...[
            has(REPORT) ? act(t("Report"), () => void this.open(REPORT, true)) : flies ? act(t("Make the report"), () => void this.make("report")) : null,
            ...(flies ? [act(t("Maps"), () => void this.make("maps")), act(t("Tables as CSV"), () => void this.make("csv")), act(t("Tables as Parquet"), () => void this.make("parquet"))] : []),
            act(t("Files"), () => void this.show()), flies ? act(t("Delete"), () => this.ask()) : null,
        ].filter((one) => one !== null));
    }

    /** Reads what is known of the run. */
    async read(): Promise<void> {
        const listed = await this.conversation.call({ call: "files", run: this.run.name });
        if (listed.reply !== "files") return;
        this.names = listed.files.map((file) => file.name);
        this.buttons();
        const [manifest, figures] = [await this.json<Manifest>(MANIFEST), await this.json<Figures>(FIGURES)];
        const assessed = figures?.runs?.[0], sensors = assessed?.sensors ?? [];
        const began = Date.parse(utc(manifest?.started_utc)), ended = Date.parse(utc(manifest?.ended_utc));
        const length_s = assessed?.recording?.duration_s ?? (ended - began) / 1000;
        this.facts.textContent = [` ${bytes(this.run.bytes)}`, Number.isFinite(length_s) ? duration(length_s) : "", sensors.length ? sensors.map((one) => `${one.channel.replace(/^sensor\//, "")} (${one.samples})`).join(", ") : ""].filter(Boolean).join(", ");
        this.verdict.className = { good: "good", bad: "bad" }[assessed?.verdict?.grade ?? ""] ?? "soft";
        this.verdict.textContent = assessed?.verdict?.sentence ?? [manifest?.ended_because, t("not assessed yet: make the report")].filter(Boolean).join("; ");
    }

    private async json<T>(file: string): Promise<T | null> {
        if (!this.names.includes(file)) return null;
        const reply = await this.conversation.call({ call: "open", run: this.run.name, file, show: false });
        if (reply.reply !== "download") return null;
        try { return await (await fetch(reply.path)).json() as T; } catch { return null; }
    }

    private fail(reply: Reply, words: string): void {
        this.said.hidden = false;
        this.said.textContent = words_of(reply, words);
    }

    /** Makes files of the run and shows them. */
    private async make(what: What): Promise<void> {
        this.said.hidden = true;
        this.files.replaceChildren(h("p", { class: "soft", role: "status" }, t("the robot makes these files; it can take minutes")));
        const before = new Set(this.names), reply = await this.conversation.call({ call: "make", run: this.run.name, what }, MAKING_MS);
        this.files.replaceChildren();
        if (reply.reply !== "done") { this.fail(reply, t("they cannot be made")); return; }
        await this.read();
        const folder = { report: "report.", maps: "map/", csv: "export/", parquet: "export/" }[what];
        await this.show((file) => !before.has(file.name) || file.name.startsWith(folder));
    }

    private async show(wanted: (file: FileRow) => boolean = () => true): Promise<void> {
        const { files } = this;
        if (files.childElementCount) { files.replaceChildren(); return; }
        const reply = await this.conversation.call({ call: "files", run: this.run.name });
        if (reply.reply !== "files") { this.fail(reply, t("no list")); return; }
        files.replaceChildren(...reply.files.filter(wanted).map((file) => h("div", { class: "line" }, h("span", {}, `${file.name} `, h("span", { class: "soft" }, bytes(file.bytes))), h("span", { class: "row" },
            SHOWS.test(file.name) ? h("button", { class: "button", type: "button", "aria-label": t("Show {name}", { name: file.name }), click: () => void this.open(file.name, true) }, t("Show")) : null,
            h("button", { class: "button", type: "button", "aria-label": t("Download {name}", { name: file.name }), click: () => void this.open(file.name, false) }, t("Download"))))));
    }

    /** Shows a file in a tab of its own, in which nothing acts, or downloads it. */
    private async open(file: string, show: boolean): Promise<void> {
        // A tab is opened by a press only.
        const tab = show ? window.open("", "_blank") : null;
        const reply = await this.conversation.call({ call: "open", run: this.run.name, file, show });
        if (reply.reply !== "download") { tab?.close(); this.fail(reply, t("it cannot be downloaded")); return; }
        if (tab) { tab.location.href = reply.path; return; }
        const link = show ? h("a", { href: reply.path, target: "_blank", rel: "noopener" }) : h("a", { href: reply.path, download: "" });
        document.body.append(link);
        link.click();
        link.remove();
    }

    /** Asks twice before the run is deleted. */
    private ask(): void {
        const { name } = this.run, keep = () => this.buttons();
        this.acts.replaceChildren(h("p", { class: "bad" }, t("Delete the run {name} with all its files from the robot?", { name })), h("button", { class: "button", type: "button", click: keep }, t("Keep it")),
            h("button", { class: "button", type: "button", click: () => void question(t("The run {name} is lost for good. Delete it?", { name }), t("Delete it for good")).then((yes) => (yes ? this.remove() : keep())) }, t("Delete it")));
    }

    private async remove(): Promise<void> {
        const reply = await this.conversation.call({ call: "remove", run: this.run.name }, MAKING_MS);
        if (reply.reply === "done") { this.removed(); return; }
        this.buttons();
        this.fail(reply, t("it cannot be deleted"));
    }
}

/** `2026-03-01 12:00:00 UTC` as a browser reads it. */
const utc = (text: string | undefined) => (text ?? "").replace(" UTC", "Z").replace(" ", "T");

function words_of(reply: Reply, otherwise: string): string {
    return "sentence" in reply ? sentence("reason" in reply ? reply.reason : 0, reply.sentence) : otherwise;
}

const problem = (reply: Reply, otherwise: string) => h("p", { class: "bad" }, words_of(reply, otherwise));
