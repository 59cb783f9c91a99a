// The processes, the log, and who may do what.

import { bytes, h, renew } from "./dom.js";
import type { Conversation, Store } from "./link.js";
import type { Answer } from "./protocol.js";

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
            card("This browser", this.pairing), card("Run", this.facts), card("Processes", this.processes, this.slots), card("What happened", this.log)));
    }

    private said(answer: Answer): void {
        this.answer.hidden = false;
        this.answer.classList.toggle("refused", answer.accepted !== "accepted");
        this.answer.textContent = answer.sentence;
    }

    private restart(name: string): void {
        if (confirm(`Restart ${name}?`)) void this.conversation.ask({ verb: "restart-process", name }).then((answer) => this.said(answer));
    }

    draw(): void {
        const { robot, welcome, link, state, events } = this.store;
        renew(this.pairing, JSON.stringify(welcome), () => {
            const secret = h("input", { type: "password", autocomplete: "off", "aria-label": "token" });
            const words = welcome?.paired ? `Paired as ${welcome.user}, with the role ${welcome.role}.` : "Not paired: this browser may look and stop. To fly, run `nims page pair NAME` on the robot and open the address that it prints, or enter the token.";
            return [welcome?.sentence ? h("p", { class: "bad" }, welcome.sentence) : null, h("p", {}, words), welcome?.paired
                ? h("button", { class: "button", type: "button", click: () => this.conversation.unpair() }, "Forget the token")
                : h("form", { class: "row", submit: (event: Event) => { event.preventDefault(); this.conversation.pair(secret.value); } }, h("label", { class: "wide" }, "token", secret), h("button", { class: "button" }, "Pair"))];
        });
        const recorder = robot?.recorder;
        const facts = [link?.robot ? `robot ${link.robot}` : "", link?.run ? `run ${link.run}` : "no robot runs", recorder ? recorder.problem ?? `recording, ${bytes(recorder.bytes)} so far, ${bytes(recorder.disk_free_bytes)} free` : "", state?.cycle?.summary ?? "", robot?.unknown_channels.length ? `not of this version: ${robot.unknown_channels.join(", ")}` : ""].filter(Boolean);
        renew(this.facts, facts.join("\n"), () => facts.map((fact) => h("p", {}, fact)));
        const processes = robot?.processes ?? [];
        renew(this.processes, JSON.stringify([processes, this.store.flies]), () => processes.map((row) => h("div", { class: "line" },
            h("span", {}, h("b", {}, row.name), " ", h("span", { class: row.well ? "good" : "bad" }, row.state), row.restarts ? `, restarted ${row.restarts} times` : "", row.reason ? h("p", { class: "soft" }, row.reason) : null),
            this.store.flies ? h("button", { class: "button", type: "button", click: () => this.restart(row.name) }, "Restart") : null)));
        const slots = Object.entries(robot?.slots ?? {}).flatMap(([role, ones]) => ones.filter((one) => one.phase !== "empty").map((one) => `${role} ${one.slot}: ${one.phase}${one.in_charge ? ", in charge" : ""}${one.cause ? ` (it ${one.cause})` : ""}`));
        renew(this.slots, slots.join("\n"), () => slots.map((slot) => h("p", { class: "soft" }, slot)));
        const last = events[events.length - 1];
        renew(this.log, `${events.length} ${last?.stamp_ns}`, () => events.toReversed().map((event) => (event.type === "log"
            ? h("p", { class: event.level }, h("b", {}, event.process), ` ${event.sentence}`)
            : h("p", { class: event.accepted ? "" : "refused" }, h("b", {}, event.who), ` ${event.accepted ? "" : "refused: "}${event.sentence}`))));
    }
}
