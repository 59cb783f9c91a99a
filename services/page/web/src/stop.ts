// STOP: a press stops, held for a second it is the emergency stop. By touch, by the space bar and by the gamepad.

import { h, write } from "./dom.js";
import type { Conversation } from "./link.js";
import type { Answer } from "./protocol.js";
import { told, t } from "./lang.js";

/** Time for which STOP is held until it is the emergency stop, ms. */
const HELD_MS = 1000;
/** Time for which it is shown that the robot has taken a stop, ms. What went wrong stays until the next press or a tap. */
const TOLD_MS = 8000;
/** Buttons of a gamepad that stop: B of the standard layout, the right one of the four. */
const GAMEPAD_STOPS = [1];

export class Stop {
    readonly element: HTMLButtonElement;
    private readonly word = h("span", { class: "stop-word" }, "STOP");
    private readonly hint = h("span", { class: "stop-hint" }, t("hold 1 s: emergency stop"));
    /** The answer to the last press, in every view. */
    readonly said: HTMLElement = h("p", { class: "stop-said", role: "alert", hidden: true, click: () => { this.said.hidden = true; } });
    private presses = 0;
    private answered = 0;
    private hides = 0;
    private timer: number | null = null;
    private gamepadDown = false;

    constructor(private readonly conversation: Conversation) {
        this.element = h("button", { class: "stop", type: "button", id: "stop", "aria-label": t("Stop the robot. Hold for one second for the emergency stop.") }, this.word, this.hint);
        this.element.addEventListener("pointerdown", (event) => { event.preventDefault(); this.press(); });
        for (const end of ["pointerup", "pointercancel", "pointerleave"]) this.element.addEventListener(end, () => this.release());
        // A screen reader or a switch control clicks without a pointer.
        this.element.addEventListener("click", (event) => { if (event.detail === 0) { this.press(); this.release(); } });
        this.element.addEventListener("contextmenu", (event) => event.preventDefault());
        window.addEventListener("keydown", (event) => {
            if (event.code !== "Space" || typing(event.target)) return;
            event.preventDefault();
            if (!event.repeat) this.press();
        }, { capture: true });
        window.addEventListener("keyup", (event) => {
            if (event.code !== "Space") return;
            if (!typing(event.target)) event.preventDefault();
            this.release();
        }, { capture: true });
        // The end of a press is not seen from here on: it must not become an emergency stop.
        for (const event of ["blur", "pagehide"]) window.addEventListener(event, () => this.release());
        document.addEventListener("visibilitychange", () => { if (document.hidden) this.release(); });
        this.watchGamepads();
    }

    /** Every press stops, also one after a press whose end was not seen. */
    private press(): void {
        this.ask("stop");
        if (this.timer !== null) return;
        this.element.classList.remove("emergency");
        this.element.classList.add("pressed");
        write(this.word, t("STOPPING"));
        this.timer = window.setTimeout(() => {
            this.timer = null;
            this.element.classList.add("emergency");
            write(this.word, t("EMERGENCY STOP"));
            this.ask("estop");
        }, HELD_MS);
    }

    private ask(verb: "stop" | "estop"): void {
        const number = ++this.presses;
        this.said.hidden = true;
        void this.conversation.stop(verb).then((answer) => this.tell(number, answer));
    }

    /** Shows an answer; that of an earlier press does not replace that of a later one. */
    private tell(number: number, answer: Answer): void {
        if (number < this.answered) return;
        this.answered = number;
        const accepted = answer.accepted === "accepted";
        this.said.hidden = false;
        this.said.classList.toggle("refused", !accepted);
        write(this.said, told(answer));
        clearTimeout(this.hides);
        if (accepted) this.hides = window.setTimeout(() => { this.said.hidden = true; }, TOLD_MS);
    }

    private release(): void {
        if (this.timer !== null) clearTimeout(this.timer);
        this.timer = null;
        this.element.classList.remove("pressed", "emergency");
        write(this.word, "STOP");
    }

    private watchGamepads(): void {
        const look = () => {
            const down = navigator.getGamepads().some((pad) => pad !== null && GAMEPAD_STOPS.some((button) => pad.buttons[button]?.pressed));
            if (down && !this.gamepadDown) this.press();
            if (!down && this.gamepadDown) this.release();
            this.gamepadDown = down;
        };
        // Not by frames: they rest while the page is hidden.
        if ("getGamepads" in navigator) setInterval(look, 20);
    }
}

/** A space in a text is a space; everywhere else it stops. */
function typing(target: EventTarget | null): boolean {
    return target instanceof HTMLTextAreaElement || (target instanceof HTMLInputElement && ["text", "search", "password"].includes(target.type));
}
