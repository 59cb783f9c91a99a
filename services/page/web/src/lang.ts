// Languages of the page: its labels, the sentences of the catalogue of answers, and those of the guided calibration.

import de from "./lang/de.json";
import en from "./lang/en.json";
import es from "./lang/es.json";
import fr from "./lang/fr.json";
import reasons from "./lang/reasons.json";

/** A language: its words for the English labels, its sentences by the numbers of the reasons, and those for the English sentences of the guided calibration. */
interface Language { name: string; labels: Record<string, string>; reasons: Record<string, string>; guide: Record<string, string> }

const KEPT = "nims-language";
/** English has words of its own only where those of `nims setup` are for a terminal: here, buttons do that. */
const ENGLISH: Language = { name: "English", labels: {}, reasons: {}, guide: en.guide };
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
    const values = matched(template, english);
    return values ? filled(translated, Object.fromEntries(Object.entries(values).map(([name, value]) => [name, word(value)]))) : english;
}

/** The parameters that an English text has in the places of its template; null if it is not of that template. Those with a name like `counted` are whole numbers. */
function matched(template: string, english: string, counted = /^$/): Record<string, string> | null {
    const names: string[] = [];
    const pattern = template.split(/(\{\w+\})/).map((part) => {
        if (!/^\{\w+\}$/.test(part)) return part.replace(/[.*+?^${}()|[\]\\]/g, "\\$&");
        const name = part.slice(1, -1);
        names.push(name);
        return counted.test(name) ? "(\\d+)" : "(.*?)";
    });
    const found = new RegExp(`^${pattern.join("")}$`, "s").exec(english);
    return found ? Object.fromEntries(names.map((name, i) => [name, found[i + 1] ?? ""])) : null;
}

/** The sentences of the guided calibration; those with the most words of their own first, so that none is taken for a part of another. */
const GUIDE = Object.entries(language.guide).map(([template, translated]) => [template.trimStart(), translated.trimStart()] as const).sort(([a], [b]) => own(b) - own(a));
const COUNTED = /^(cable|cables|count|from|line|most|of|open|other|point|points|pulley|to|FEWEST|MOST|POINTS)$/;
function own(template: string): number { return template.replace(/\{\w+\}/g, "").length; }

/** A text of the guided calibration in the language of the browser: its sentences stand within each other, and one after the other in lines. */
export function guided(english: string): string {
    // A clause is told as a sentence, with a capital letter and a full stop.
    const clause = english.charAt(0).toLowerCase() + english.slice(1);
    for (const [template, translated] of GUIDE) {
        // Sentences that stand in lines are told one by one.
        if (english.includes("\n") && !template.includes("\n")) continue;
        for (const text of [english, clause, clause.replace(/\.$/, ""), english.replace(/\.$/, "")]) {
            const values = matched(template, text, COUNTED);
            if (!values) continue;
            const told = filled(translated, Object.fromEntries(Object.entries(values).map(([name, value]) => [name, value === english ? value : guided(value)])));
            const begun = text.charAt(0) === english.charAt(0) ? told : told.charAt(0).toUpperCase() + told.slice(1);
            return text.endsWith(".") || !english.endsWith(".") ? begun : `${begun}.`;
        }
    }
    return english.includes("\n") ? english.split("\n").map(guided).join("\n") : english;
}

/** A word of the server in the language of the browser, if it is one of those below. */
function word(english: string): string { return language.labels[english] ?? english; }

function filled(text: string, values: Record<string, string | number>): string {
    return text.replace(/\{(\w+)\}/g, (whole, name: string) => String(values[name] ?? whole));
}

/** Words of the server that are shown as they come, or stand in its sentences. */
export const WORDS = [t("accepted"), t("continues"), t("controller"), t("estimator"), t("pays out"), t("reels in"), t("the node"), t("disarmed"), t("holding"), t("jogging"), t("soft"), t("following"), t("stopping"), t("faulted"), t("emergency stop"), t("unknown"), t("running"), t("paused"), t("ready"), t("done"), t("aborted"), t("refused"), t("idle")];
