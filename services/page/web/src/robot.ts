// The processes, the log, and who may do what.

import { bytes, h, renew } from "./dom.js";
import type { Conversation, Store } from "./link.js";
import type { Answer, Process, Request, Slot } from "./protocol.js";
import { question } from "./question.js";
import { LANGUAGES, choose, chosen, sentence, t, translate } from "./lang.js";

/** States of a process that runs. */
const RUNS = ["starting", "ready", "running", "SILENT", "stopping"];

export class RobotView {
    readonly element: HTMLElement;
    private readonly processes = h("div", { class: "table" });
    private readonly slots = h("div", { class: "table" });
    private readonly sensors = h("div", { class: "table" });
    private readonly versions = h("div", { class: "table" });
    private readonly facts = h("div", { class: "table" });
    private readonly log = h("div", { class: "log", role: "log" });
    private readonly pairing = h("div", { class: "table" });
    private readonly answer = h("p", { class: "answer", role: "status", hidden: true });

    constructor(private readonly store: Store, private readonly conversation: Conversation) {
        const card = (name: string, ...children: HTMLElement[]) => h("section", { class: "card" }, h("h2", {}, name), ...children);
        this.element = h("div", { class: "view" }, this.answer, h("div", { class: "columns table" },
            card(t("This browser"), this.pairing, language()), card(t("Run"), this.facts, this.versions), card(t("Processes"), this.processes), card(t("Controllers and estimators"), this.slots), card(t("Sensors"), this.sensors), card(t("What happened"), this.log)));
    }

    private said(answer: Answer): void {
        this.answer.hidden = false;
        this.answer.classList.toggle("refused", answer.accepted !== "accepted");
        this.answer.textContent = sentence(answer.reason, answer.sentence);
    }

    private async ask(request: Request, words: string | null = null): Promise<void> {
        if (words === null || await question(words)) this.said(await this.conversation.ask(request));
    }

    /** What can be done with a process. */
    private acts({ name, state }: Process): HTMLElement {
        const act = (words: string, does: () => void) => h("button", { class: "button", type: "button", "aria-label": `${words} ${name}`, click: does }, words);
        return h("span", { class: "row" }, ...(RUNS.includes(state)
            ? [act(t("Restart"), () => void this.ask({ verb: "restart-process", name }, t("Restart {name}?", { name }))), act(t("Stop"), () => void this.ask({ verb: "stop-process", name }, t("Stop {name}?", { name })))]
            : [act(t("Start"), () => void this.ask({ verb: "start-process", name, slot: null, law: null })), act(t("Unplug"), () => void this.ask({ verb: "unplug", name }, t("Remove {name} from the robot until the next start?", { name })))]));
    }

    /** Controllers and estimators: which one is in charge, how far the other one is qualified, and what can be done. */
    private role(role: string, slots: Slot[], laws: string[]): HTMLElement {
        const button = (words: string, does: () => void, main = false) => h("button", { class: main ? "button main" : "button", type: "button", click: does }, words);
        const rows = slots.map((one) => {
            const words = [one.phase === "empty" ? t("empty") : one.phase, one.in_charge ? t("in charge") : "", one.cause ? `(${translate(one.cause)})` : "", one.failures ? t("{n} failures", { n: one.failures }) : "",
                one.deviation !== null && !one.in_charge ? t("differs by {value}", { value: `${(1000 * one.deviation).toFixed(1)} ${role === "controller" ? "mm/s" : "mm"}` }) : ""].filter(Boolean).join(", ");
            const law = h("select", { "aria-label": t("law or method of {role} {slot}", { role, slot: one.slot }) }, ...laws.map((name) => h("option", { value: name }, name)));
            const start = () => void this.ask({ verb: "start-process", name: role, slot: one.slot, law: law.value });
            const process = one.slot === "a" ? role : `${role}-b`;
            return h("div", { class: "table" }, h("p", {}, h("b", {}, `${role} ${one.slot}`), ` ${words}`),
                one.in_charge || one.phase === "empty" ? null : h("meter", { min: 0, max: one.qualify_cycles, value: Math.min(one.good_cycles, one.qualify_cycles), "aria-label": t("qualification of {role} {slot}", { role, slot: one.slot }) }),
                !this.store.flies || one.in_charge ? null : h("div", { class: "row" },
                    ...(one.phase === "empty" ? [law, button(t("Start it here"), start)] : []),
                    one.phase === "qualified" ? button(t("Put in charge"), () => void this.ask({ verb: "swap", role, slot: one.slot }, t("Put {role} {slot} in charge?", { role, slot: one.slot })), true) : null,
                    one.phase === "quarantined" ? button(t("Admit again"), () => void this.ask({ verb: "admit", role, slot: one.slot })) : null,
                    one.phase === "empty" ? null : button(t("Stop"), () => void this.ask({ verb: "stop-process", name: process }, t("Stop {name}?", { name: process })))));
        });
        return h("div", { class: "table" }, ...rows);
    }

    /** Sensors that the system file declares as plug-ins, and all that publish. */
    private sensorRows(): HTMLElement[] {
        const publishing = this.store.robot?.sensors ?? [], declared = this.store.scene?.plugins ?? [];
        const names = [...new Set([...declared, ...publishing])].sort();
        return names.map((name) => {
            const is = publishing.includes(name), button = (words: string, does: () => void) => h("button", { class: "button", type: "button", "aria-label": `${words} ${name}`, click: does }, words);
            return h("div", { class: "line" }, h("span", {}, h("b", {}, name), " ", h("span", { class: is ? "good" : "soft" }, is ? t("publishes") : t("publishes nothing"))),
                this.store.flies && declared.includes(name) ? h("span", { class: "row" }, button(t("Plug in"), () => void this.ask({ verb: "start-process", name, slot: null, law: null })), button(t("Unplug"), () => void this.ask({ verb: "stop-process", name }, t("Stop {name}?", { name })))) : null);
        });
    }

    draw(): void {
        const { robot, welcome, link, state, events, seat, unpaired } = this.store;
        renew(this.pairing, JSON.stringify([welcome, unpaired, seat.flyer]), () => {
            const secret = h("input", { type: "text", autocomplete: "off", autocapitalize: "characters", spellcheck: "false", "aria-label": t("code") });
            const words = welcome?.paired ? t("Paired as {user}, with the role {role}.", { user: welcome.user, role: welcome.role }) : t("Not paired: this browser may look and stop. To fly, run `sudo nims page pair NAME` on the robot and enter the code that it prints, or open its address.");
            return [welcome?.sentence ?? unpaired ? h("p", { class: "bad" }, unpaired ?? welcome?.sentence ?? "") : null, h("p", {}, words), welcome?.paired
                ? h("div", { class: "row" }, h("button", { class: "button", type: "button", click: () => this.conversation.unpair() }, t("End the pairing")),
                    seat.flyer === welcome.user ? h("button", { class: "button", type: "button", click: () => void this.conversation.seat("give") }, t("Fly no more")) : null)
                : h("form", { class: "row", submit: (event: Event) => { event.preventDefault(); void this.conversation.pair(secret.value); } }, h("label", { class: "wide" }, t("code"), secret), h("button", { class: "button" }, t("Pair")))];
        });
        const recorder = robot?.recorder;
        const facts = [link?.robot ? t("robot {name}", { name: link.robot }) : "", link?.run ? t("run {name}", { name: link.run }) : t("no robot runs"), recorder ? recorder.problem ?? (recorder.silent_s != null ? t("recorder silent for {s} s", { s: recorder.silent_s }) : t("recording, {bytes} so far, {free} free", { bytes: bytes(recorder.bytes ?? 0), free: bytes(recorder.disk_free_bytes ?? 0) })) : "", state?.cycle?.summary ?? "", robot?.unknown_channels.length ? t("not of this version: {channels}", { channels: robot.unknown_channels.join(", ") }) : ""].filter(Boolean);
        renew(this.facts, facts.join("\n"), () => facts.map((fact) => h("p", {}, fact)));
        const processes = robot?.processes ?? [];
        renew(this.processes, JSON.stringify([processes, this.store.flies]), () => processes.map((row) => h("div", { class: "line" },
            h("span", {}, h("b", {}, row.name), " ", h("span", { class: row.well ? "good" : "bad" }, row.state), row.restarts ? `, ${t("restarted {n} times", { n: row.restarts })}` : "", row.reason ? h("p", { class: "soft" }, row.reason) : null),
            this.store.flies ? this.acts(row) : null)));
        // A list that is open is left alone; deviations change all the time.
        const laws = this.store.scene?.laws ?? {}, isChosen = this.slots.contains(document.activeElement) && document.activeElement?.tagName === "SELECT";
        if (!isChosen) renew(this.slots, JSON.stringify([robot?.slots, this.store.flies, laws]), () => Object.entries(robot?.slots ?? {}).map(([role, ones]) => this.role(role, ones, laws[role] ?? [])));
        renew(this.sensors, JSON.stringify([robot?.sensors, this.store.scene?.plugins, this.store.flies]), () => { const rows = this.sensorRows(); return rows.length ? rows : [h("p", { class: "soft" }, t("no sensor publishes, and the system file declares no plug-in"))]; });
        const versions = [welcome ? t("page {version}", { version: welcome.version }) : "", robot?.version ? t("robot {version}", { version: robot.version }) : ""].filter(Boolean);
        renew(this.versions, versions.join("\n"), () => versions.map((version) => h("p", { class: "soft" }, version)));
        const last = events[events.length - 1];
        renew(this.log, `${events.length} ${last?.stamp_ns}`, () => events.toReversed().map((event) => (event.type === "log"
            ? h("p", { class: event.level }, h("b", {}, event.process), ` ${event.sentence}`)
            : event.type === "swap" ? h("p", { class: "warning" }, h("b", {}, t("swap")), ` ${t("{role} {slot} is in charge", { role: event.role, slot: event.slot })}`)
            : h("p", { class: event.accepted ? "" : "refused" }, h("b", {}, event.who), ` ${event.accepted ? "" : `${t("refused")}: `}${sentence(event.reason, event.sentence)}`))));
    }
}

/** The choice of the language. */
function language(): HTMLElement {
    const options = Object.entries(LANGUAGES).map(([code, one]) => h("option", { value: code, selected: code === chosen }, one.name));
    const select = h("select", { "aria-label": t("language"), change: () => choose(select.value) }, ...options);
    return h("label", {}, t("language"), select);
}
