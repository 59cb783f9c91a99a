// The finished runs and their files.

import { bytes, h } from "./dom.js";
import type { Conversation } from "./link.js";
import { sentence, t } from "./lang.js";

export class Runs {
    readonly element: HTMLElement;
    private readonly list = h("div", { class: "table" });

    constructor(private readonly conversation: Conversation) {
        this.element = h("div", { class: "view" }, h("section", { class: "card" }, h("div", { class: "row" }, h("h2", {}, t("Finished runs")), h("button", { class: "button", type: "button", click: () => void this.load() }, t("Look again"))), this.list));
    }

    /** Asks for the list. */
    async load(): Promise<void> {
        const reply = await this.conversation.call({ call: "runs" });
        if (reply.reply !== "runs") { this.list.replaceChildren(h("p", { class: "bad" }, "sentence" in reply ? sentence("reason" in reply ? reply.reason : 0, reply.sentence) : t("no list"))); return; }
        const rows = reply.runs.toReversed().map((run) => {
            const files = h("div", { class: "table" }), open = h("button", { class: "button", type: "button", "aria-expanded": false, click: () => void this.files(run.name, files, open) }, t("Files"));
            return h("div", {}, h("div", { class: "line" }, h("span", {}, h("b", {}, run.name), ` ${bytes(run.bytes)}, ${t("{n} files", { n: run.files })}`), open), files);
        });
        this.list.replaceChildren(...(rows.length ? rows : [h("p", { class: "soft" }, t("no finished run yet; a run ends when the robot is switched off"))]));
    }

    private async files(run: string, into: HTMLElement, button: HTMLElement): Promise<void> {
        if (into.childElementCount) { into.replaceChildren(); button.setAttribute("aria-expanded", "false"); return; }
        const reply = await this.conversation.call({ call: "files", run });
        if (reply.reply !== "files") { into.replaceChildren(h("p", { class: "bad" }, "sentence" in reply ? sentence("reason" in reply ? reply.reason : 0, reply.sentence) : t("no list"))); return; }
        button.setAttribute("aria-expanded", "true");
        into.replaceChildren(...reply.files.map((file) => h("div", { class: "line" }, h("span", {}, `${file.name} `, h("span", { class: "soft" }, bytes(file.bytes))),
            h("button", { class: "button", type: "button", click: () => void this.fetch(run, file.name, into) }, t("Download")))));
    }

    private async fetch(run: string, file: string, into: HTMLElement): Promise<void> {
        const reply = await this.conversation.call({ call: "open", run, file });
        if (reply.reply === "download") {
            const link = h("a", { href: reply.path, download: "" });
            document.body.append(link);
            link.click();
            link.remove();
        } else into.prepend(h("p", { class: "bad" }, "sentence" in reply ? sentence("reason" in reply ? reply.reason : 0, reply.sentence) : t("it cannot be downloaded")));
    }
}
