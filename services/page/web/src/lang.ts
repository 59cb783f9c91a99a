// Languages of the page: its labels, and the sentences of the catalogue of answers.

import de from "./lang/de.json";
import es from "./lang/es.json";
import fr from "./lang/fr.json";
import reasons from "./lang/reasons.json";

/** A language: its words for the English labels, and its sentences by the numbers of the reasons. */
interface Language { name: string; labels: Record<string, string>; reasons: Record<string, string> }

const KEPT = "nims-language";
const ENGLISH: Language = { name: "English", labels: {}, reasons: {} };
export const LANGUAGES: Record<string, Language> = { en: ENGLISH, de, es, fr };

/** The language of this browser: the chosen one, otherwise that of its settings. */
export const chosen = [localStorage.getItem(KEPT), ...navigator.languages.map((language) => language.slice(0, 2))].find((code) => code !== null && code in LANGUAGES) ?? "en";
const language = LANGUAGES[chosen] ?? ENGLISH;
document.documentElement.lang = chosen;

/** Shows the page in another language. */
export function choose(code: string): void {
    localStorage.setItem(KEPT, code);
    location.reload();
}

/** A label in the language of the browser; `{name}` stands for a value. */
export function t(label: string, values: Record<string, string | number> = {}): string {
    return filled(language.labels[label] ?? label, values);
}

/** The sentence of a reason in the language of the browser: its parameters are those of the English one. */
export function sentence(reason: number, english: string): string {
    const template = (reasons as Record<string, string>)[reason], translated = language.reasons[reason];
    if (!template || !translated) return english;
    const names: string[] = [];
    const pattern = template.split(/(\{\w+\})/).map((part) => {
        if (!/^\{\w+\}$/.test(part)) return part.replace(/[.*+?^${}()|[\]\\]/g, "\\$&");
        names.push(part.slice(1, -1));
        return "(.*?)";
    });
    const found = new RegExp(`^${pattern.join("")}$`, "s").exec(english);
    return found ? filled(translated, Object.fromEntries(names.map((name, i) => [name, word(found[i + 1] ?? "")]))) : english;
}

/** A word of the server in the language of the browser, if it is one of those below. */
function word(english: string): string { return language.labels[english] ?? english; }

function filled(text: string, values: Record<string, string | number>): string {
    return text.replace(/\{(\w+)\}/g, (whole, name: string) => String(values[name] ?? whole));
}

/** Words of the server that are shown as they come, or stand in its sentences. */
export const WORDS = [t("accepted"), t("continues"), t("controller"), t("estimator"), t("pays out"), t("reels in"), t("the node"), t("disarmed"), t("holding"), t("jogging"), t("soft"), t("following"), t("stopping"), t("faulted"), t("emergency stop"), t("unknown"), t("running"), t("paused"), t("ready"), t("done"), t("aborted"), t("refused"), t("idle")];
