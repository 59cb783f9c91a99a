// Languages of the page: its labels, the sentences of the catalogue of answers with their clauses, the faults, and the
// sentences of the guided calibration.

import de from "./lang/de.json";
import en from "./lang/en.json";
import es from "./lang/es.json";
import fr from "./lang/fr.json";
import faults from "./lang/faults.json";
import reasons from "./lang/reasons.json";

/** A language: its words for the English labels, its sentences by the numbers of the reasons, and those for the English clauses and sentences of the guided calibration; and by the English clause of each fault its own, the effect and the cure. */
interface Language {
    name: string; labels: Record<string, string>; reasons: Record<string, string>; guide: Record<string, string>;
    clauses: Record<string, string>; faults: Record<string, string[]>;
}

const KEPT = "nims-language";
/** English has words of its own only where those of `nims setup` are for a terminal: here, buttons do that. */
const ENGLISH: Language = { name: "English", labels: {}, reasons: {}, guide: en.guide, clauses: {}, faults: {} };
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
    // A sentence that is a parameter alone has no words of its own.
    if (!template || !translated) return translate(english);
    const values = matched(pattern(template, translated, /^$/), english);
    return values ? filled(translated, all(values)) : translate(english);
}

/** An answer as the page shows it. */
export function told(answer: { accepted: string; reason: number; sentence: string }): string {
    const text = sentence(answer.reason, answer.sentence);
    return `${answer.accepted === "accepted" ? "✓" : "✕"} ${text.charAt(0).toUpperCase()}${text.slice(1)}`;
}

/** What a template looks for: its pattern, the names of its parameters, and the text in the language of the browser. */
interface Pattern { looks: RegExp; names: string[]; translated: string; lines: boolean; own: number }

/** Parameters that are whole numbers, and the cables or units of a fault. */
const COUNTED = /^(cable|cables|count|from|left_out|line|most|of|open|other|point|points|pulley|to|FEWEST|MOST|POINTS)$/;
const PLACE = "((?: \\(| on )(?:cable|unit)s? [\\d, ]+\\)?|)";

function pattern(template: string, translated: string, counted = COUNTED): Pattern {
    const names: string[] = [];
    const parts = template.split(/(\{\w+\})/).map((part) => {
        if (!/^\{\w+\}$/.test(part)) return part.replace(/[.*+?^${}()|[\]\\]/g, "\\$&");
        const name = part.slice(1, -1);
        names.push(name);
        return name === "place" ? PLACE : counted.test(name) ? "(\\d+)" : "(.*?)";
    });
    return { looks: new RegExp(`^${parts.join("")}$`, "s"), names, translated, lines: template.includes("\n"), own: template.replace(/\{\w+\}/g, "").length };
}

/** The parameters that an English text has in the places of a template; null if it is not of that template. */
function matched({ looks, names }: Pattern, english: string): Record<string, string> | null {
    const found = looks.exec(english);
    return found ? Object.fromEntries(names.map((name, i) => [name, found[i + 1] ?? ""])) : null;
}

/** The forms in which a fault is told: alone with its cure, as one of several that forbid something, and as the end of a mission. */
function faultForms([clause = "", effect = "", cure = ""]: string[]): string[] {
    const begun = clause.charAt(0).toUpperCase() + clause.slice(1);
    return [`${begun}${effect}: ${cure}{place}`, `${clause}${effect}{place} (${cure})`, `${clause}{place}`];
}

/** The sentences and clauses; those with the most words of their own first, so that none is taken for a part of another. */
const PATTERNS: Pattern[] = [
    ...Object.entries(language.guide).map(([template, translated]) => pattern(template.trimStart(), translated.trimStart())),
    ...Object.entries(language.clauses).map(([template, translated]) => {
        const bare = /[^.]\.$/.test(template) && translated.endsWith(".") ? -1 : undefined;
        // The end of a sentence stands behind what it adds to.
        const head = /^[ ,;]/.test(template) ? "{head}" : "";
        return pattern(head + template.slice(0, bare), head + translated.slice(0, bare));
    }),
    ...faults.flatMap((fault) => {
        const own = language.faults[fault[0] ?? ""];
        return own ? faultForms(fault).map((form, i) => pattern(form, faultForms(own)[i] ?? form)) : [];
    }),
].sort((a, b) => b.own - a.own);

/** A text of the server in the language of the browser: its sentences and clauses stand within each other, and one after the other in lines. */
export function translate(english: string): string {
    return translation(english) ?? (english.includes("\n") ? english.split("\n").map(translate).join("\n") : english);
}

function translation(english: string): string | null {
    const own = place(english) ?? language.labels[english];
    if (own) return own;
    // A clause is told as a sentence, with a capital letter and a full stop.
    const clause = english.charAt(0).toLowerCase() + english.slice(1);
    for (const one of PATTERNS) {
        // Sentences that stand in lines are told one by one.
        if (english.includes("\n") && !one.lines) continue;
        for (const text of [english, clause, clause.replace(/\.$/, ""), english.replace(/\.$/, "")]) {
            const values = matched(one, text);
            if (!values || Object.values(values).includes(english)) continue;
            const whole = filled(one.translated, all(values));
            const begun = text.charAt(0) === english.charAt(0) ? whole : whole.charAt(0).toUpperCase() + whole.slice(1);
            return text.endsWith(".") || !english.endsWith(".") ? begun : `${begun}.`;
        }
    }
    return several(english);
}

/** Several clauses in a row, if each is known. */
function several(english: string): string | null {
    for (let at = english.indexOf(", and "); at >= 0; at = english.indexOf(", and ", at + 1)) {
        const one = translation(english.slice(0, at)), rest = one === null ? null : translation(english.slice(at + 6));
        if (one !== null && rest !== null) return t("{one}, and {rest}", { one, rest });
    }
    return null;
}

/** The cables or drive units of a fault. */
function place(english: string): string | null {
    const found = /^( \(| on )(cable|unit)(s?) ([\d, ]+)\)?$/.exec(english);
    if (!found) return null;
    const numbers = { numbers: found[4] ?? "" }, several = found[3] === "s";
    const named = found[2] === "cable" ? (several ? t("cables {numbers}", numbers) : t("cable {numbers}", numbers)) : several ? t("units {numbers}", numbers) : t("unit {numbers}", numbers);
    return ` (${named})`;
}

function all(values: Record<string, string>): Record<string, string> {
    return Object.fromEntries(Object.entries(values).map(([name, value]) => [name, translate(value)]));
}

function filled(text: string, values: Record<string, string | number>): string {
    return text.replace(/\{(\w+)\}/g, (whole, name: string) => String(values[name] ?? whole));
}

/** Words of the server that are shown as they come, or stand in its sentences. */
export const WORDS = [t("above the upper"), t("accepted"), t("below the lower"), t("end"), t("pay out"), t("reel in"), t("start"), t("continues"), t("controller"), t("estimator"), t("pays out"), t("reels in"), t("the node"), t("disarmed"), t("holding"), t("jogging"), t("soft"), t("following"), t("stopping"), t("faulted"), t("emergency stop"), t("unknown"), t("running"), t("paused"), t("ready"), t("done"), t("aborted"), t("refused"), t("idle")];
