// The processes, the log, and who may do what.

import { bytes, h, renew } from "./dom.js";
import type { Conversation, Store } from "./link.js";
import type { Answer } from "./protocol.js";
import { LANGUAGES, choose, chosen, sentence, t } from "./lang.js";

export class RobotView {
    readonly element: HTMLElement;
    private readonly processes = h("div", { class: "table" });
    private readonly slots = h("div", { class: "table" });
    private readonly facts = h("div", { class: "table" });
    private readonly log = h("div", { class: "log", role: "log" });
    private readonly pairing = h("div", { class: "table" });
    private readonly answer = h("p", { class: "answer", role: "status", hidden: true });

    constructor(private readonly store: Store, private readonly conversation: Conversation) {
        const card = (name: string, ...children: HTMLElement[]) => h("section", { class: "card" }, h("h2", {}, name), ...children);
        this.element = h("div", { class: "view" }, this.answer, h("div", { class: "columns table" },
            card(t("This browser"), this.pairing, language()), card(t("Run"), this.facts), card(t("Processes"), this.processes, this.slots), card(t("What happened"), this.log)));
    }

    private said(answer: Answer): void {
        this.answer.hidden = false;
        this.answer.classList.toggle("refused", answer.accepted !== "accepted");
        this.answer.textContent = sentence(answer.reason, answer.sentence);
    }

    private restart(name: string): void {
        if (confirm(t("Restart {name}?", { name }))) void this.conversation.ask({ verb: "restart-process", name }).then((answer) => this.said(answer));
    }

    draw(): void {
        const { robot, welcome, link, state, events, seat, unpaired } = this.store;
        renew(this.pairing, JSON.stringify([welcome, unpaired, seat.flyer]), () => {
            const secret = h("input", { type: "text", autocomplete: "off", autocapitalize: "characters", spellcheck: "false", "aria-label": t("code") });
            const words = welcome?.paired ? t("Paired as {user}, with the role {role}.", { user: welcome.user, role: welcome.role }) : t("Not paired: this browser may look and stop. To fly, run `nims page pair NAME` on the robot and enter the code that it prints, or open its address.");
            return [welcome?.sentence ?? unpaired ? h("p", { class: "bad" }, unpaired ?? welcome?.sentence ?? "") : null, h("p", {}, words), welcome?.paired
                ? h("div", { class: "row" }, h("button", { class: "button", type: "button", click: () => this.conversation.unpair() }, t("End the pairing")),
                    seat.flyer === welcome.user ? h("button", { class: "button", type: "button", click: () => void this.conversation.seat("give") }, t("Fly no more")) : null)
                : h("form", { class: "row", submit: (event: Event) => { event.preventDefault(); void this.conversation.pair(secret.value); } }, h("label", { class: "wide" }, t("code"), secret), h("button", { class: "button" }, t("Pair")))];
        });
        const recorder = robot?.recorder;
        const facts = [link?.robot ? t("robot {name}", { name: link.robot }) : "", link?.run ? t("run {name}", { name: link.run }) : t("no robot runs"), recorder ? recorder.problem ?? t("recording, {bytes} so far, {free} free", { bytes: bytes(recorder.bytes), free: bytes(recorder.disk_free_bytes) }) : "", state?.cycle?.summary ?? "", robot?.unknown_channels.length ? t("not of this version: {channels}", { channels: robot.unknown_channels.join(", ") }) : ""].filter(Boolean);
        renew(this.facts, facts.join("\n"), () => facts.map((fact) => h("p", {}, fact)));
        const processes = robot?.processes ?? [];
        renew(this.processes, JSON.stringify([processes, this.store.flies]), () => processes.map((row) => h("div", { class: "line" },
            h("span", {}, h("b", {}, row.name), " ", h("span", { class: row.well ? "good" : "bad" }, row.state), row.restarts ? `, ${t("restarted {n} times", { n: row.restarts })}` : "", row.reason ? h("p", { class: "soft" }, row.reason) : null),
            this.store.flies ? h("button", { class: "button", type: "button", click: () => this.restart(row.name) }, t("Restart")) : null)));
        const slots = Object.entries(robot?.slots ?? {}).flatMap(([role, ones]) => ones.filter((one) => one.phase !== "empty").map((one) => `${role} ${one.slot}: ${one.phase}${one.in_charge ? `, ${t("in charge")}` : ""}${one.cause ? ` (it ${one.cause})` : ""}`));
        renew(this.slots, slots.join("\n"), () => slots.map((slot) => h("p", { class: "soft" }, slot)));
        const last = events[events.length - 1];
        renew(this.log, `${events.length} ${last?.stamp_ns}`, () => events.toReversed().map((event) => (event.type === "log"
            ? h("p", { class: event.level }, h("b", {}, event.process), ` ${event.sentence}`)
            : h("p", { class: event.accepted ? "" : "refused" }, h("b", {}, event.who), ` ${event.accepted ? "" : `${t("refused")}: `}${sentence(event.reason, event.sentence)}`))));
    }
}

/** The choice of the language. */
function language(): HTMLElement {
    const options = Object.entries(LANGUAGES).map(([code, one]) => h("option", { value: code, selected: code === chosen }, one.name));
    const select = h("select", { "aria-label": t("language"), change: () => choose(select.value) }, ...options);
    return h("label", {}, t("language"), select);
}
