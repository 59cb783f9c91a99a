// A question of the page before something that is not taken back. It is a part of the page and stops nothing else:
// STOP, the signs of a held motion and the drawing go on, which they would not during `confirm()` of a browser.

import { h } from "./dom.js";
import { t } from "./lang.js";

let open: ((yes: boolean) => void) | null = null;

/** Asks; false if the person cancels, or another question comes. */
export function question(words: string, yes: string = t("Yes")): Promise<boolean> {
    open?.(false);
    return new Promise((resolve) => {
        const answer = (is: boolean) => {
            element.remove();
            window.removeEventListener("keydown", cancels);
            open = null;
            resolve(is);
        };
        const cancels = (event: KeyboardEvent) => { if (event.key === "Escape") answer(false); };
        const cancel = h("button", { class: "button", type: "button", click: () => answer(false) }, t("Cancel"));
        const element = h("div", { class: "asks card", role: "alertdialog", "aria-label": words }, h("p", {}, words),
            h("div", { class: "row" }, cancel, h("button", { class: "button main", type: "button", click: () => answer(true) }, yes)));
        open = answer;
        window.addEventListener("keydown", cancels);
        document.body.append(element);
        cancel.focus({ preventScroll: true });
    });
}
