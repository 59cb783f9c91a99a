// Elements without markup from texts: a text of a robot is never HTML.

type Child = Node | string | null;
type Attributes = Record<string, string | number | boolean | ((event: never) => void)>;

/** Creates an element; a function is a listener, `true` an attribute without a value. */
export function h<K extends keyof HTMLElementTagNameMap>(tag: K, attributes: Attributes = {}, ...children: Child[]): HTMLElementTagNameMap[K] {
    const element = document.createElement(tag);
    for (const [name, value] of Object.entries(attributes)) {
        if (typeof value === "function") element.addEventListener(name, value as (event: Event) => void);
        else if (value !== false) element.setAttribute(name, value === true ? "" : String(value));
    }
    element.append(...children.filter((child) => child !== null));
    return element;
}

/** Sets a text if it has changed, so that a screen reader and a selection are left alone. */
export function write(element: Element, text: string): void {
    if (element.textContent !== text) element.textContent = text;
}

/** Replaces the children of an element only if the text that stands for them has changed. */
export function renew(element: HTMLElement, key: string, children: () => Child[]): void {
    if (element.dataset.key === key) return;
    element.dataset.key = key;
    element.replaceChildren(...children().filter((child) => child !== null));
}

export const metres = (m: number | null | undefined, digits = 2): string => (m == null ? "–" : m.toFixed(digits));

export function bytes(count: number): string {
    const units = ["B", "kB", "MB", "GB", "TB"];
    let unit = 0;
    while (count >= 1000 && unit < units.length - 1) { count /= 1000; unit += 1; }
    return `${count.toFixed(count < 10 && unit > 0 ? 1 : 0)} ${units[unit]}`;
}

export function duration(s: number): string {
    const whole = Math.max(0, Math.round(s));
    if (whole < 60) return `${whole} s`;
    return `${Math.floor(whole / 60)} min ${String(whole % 60).padStart(2, "0")} s`;
}
