// Drawings of the guided calibration: one for each step, and the site from above.

import { t } from "./lang.js";
import type { Open, SiteMap } from "./protocol.js";

const SVG = "http://www.w3.org/2000/svg";
type Attributes = Record<string, string | number>;

function s(tag: string, attributes: Attributes, ...children: (SVGElement | string)[]): SVGElement {
    const element = document.createElementNS(SVG, tag);
    for (const [name, value] of Object.entries(attributes)) element.setAttribute(name, String(value));
    element.append(...children);
    return element;
}

const line = (x1: number, y1: number, x2: number, y2: number, kind: string) => s("line", { x1, y1, x2, y2, class: kind });
const dot = (cx: number, cy: number, r: number, kind: string) => s("circle", { cx, cy, r, class: kind });
const text = (x: number, y: number, words: string, kind = "words") => s("text", { x, y, class: kind, "text-anchor": "middle" }, words);

/** Size of a drawing of a step. */
const WIDE = 360, HIGH = 190, FLOOR = 160;

/** A pole with its pulley and its number. */
function pole(x: number, top: number, name: string, chosen = false): SVGElement[] {
    return [line(x, FLOOR, x, top, "pole"), dot(x, top, 9, chosen ? "chosen" : "pulley"), text(x, top - 15, name)];
}

/** A plumb line from a pulley to the floor. */
const plumb = (x: number, top: number): SVGElement[] => [line(x + 12, top, x + 12, FLOOR - 12, "thin"), dot(x + 12, FLOOR - 10, 5, "weight")];

/** A measure between two places, with arrows. */
function measure(x1: number, y1: number, x2: number, y2: number, words: string): SVGElement[] {
    const length = Math.hypot(x2 - x1, y2 - y1), [u, v] = [(x2 - x1) / length, (y2 - y1) / length];
    const arrow = (x: number, y: number, sign: number) => s("path", { d: `M${x} ${y} l${sign * (8 * u - 4 * v)} ${sign * (8 * v + 4 * u)} M${x} ${y} l${sign * (8 * u + 4 * v)} ${sign * (8 * v - 4 * u)}`, class: "asked" });
    return [line(x1, y1, x2, y2, "asked"), arrow(x1, y1, 1), arrow(x2, y2, -1), text((x1 + x2) / 2 + 12 * Math.abs(v), (y1 + y2) / 2 - 6 * Math.abs(u), words, "asked-words")];
}

const scene = (): SVGElement[] => [line(10, FLOOR, WIDE - 10, FLOOR, "floor")];
/** A node on the floor between three poles, with cables. */
function node(x: number): SVGElement[] {
    return [...[60, 180, 300].map((from) => line(from, 46, x, FLOOR - 8, "cable")), s("rect", { x: x - 9, y: FLOOR - 16, width: 18, height: 14, rx: 3, class: "node" })];
}

const STEPS: Record<string, (open: Open) => [string, SVGElement[]]> = {
    pulleys: () => [t("Count the pulleys and number them."), [...pole(60, 46, "1"), ...pole(180, 46, "2"), ...pole(300, 46, "3 …")]],
    distance: ({ from, to }) => [t("From plumb line to plumb line, on the level."), [...pole(70, 40, String(from)), ...plumb(70, 40), ...pole(270, 52, String(to)), ...plumb(270, 52), ...measure(84, 124, 280, 124, "? m")]],
    side: ({ from, to, pulley }) => [t("Stand at one pulley and look towards the other."), [dot(180, 150, 9, "pulley"), text(205, 155, String(from)), dot(180, 44, 9, "pulley"), text(205, 49, String(to)), line(180, 138, 180, 58, "thin"), dot(70, 80, 9, "chosen"), text(70, 62, `${pulley} ?`), dot(290, 80, 9, "chosen"), text(290, 62, `${pulley} ?`), text(70, 112, t("left")), text(290, 112, t("right"))]],
    height: ({ pulley }) => [t("From the floor up to the pulley."), [...pole(150, 40, String(pulley), true), ...measure(190, FLOOR - 2, 190, 42, "? m")]],
    about: () => [t("A guess is enough."), [...pole(60, 46, "1"), ...pole(180, 52, "2"), ...pole(300, 44, "3"), ...measure(215, FLOOR - 2, 215, 48, "≈ ? m")]],
    radius: () => [t("Across the bottom of the groove, and one thickness of the cable."), [dot(180, 90, 56, "wheel"), dot(180, 90, 46, "wheel"), dot(180, 90, 5, "weight"), ...measure(134, 90, 226, 90, "? mm"), line(10, 34, 180, 34, "cable")]],
    turn: () => [t("A mark on the cable, and one turn of the wheel."), [dot(110, 92, 44, "wheel"), dot(110, 92, 5, "weight"), line(110, 48, 340, 48, "cable"), dot(130, 48, 6, "chosen"), dot(310, 48, 6, "chosen"), ...measure(130, 76, 310, 76, "? mm"), s("path", { d: "M110 120 a28 28 0 1 1 26 -18", class: "asked" })]],
    points: () => [t("Near each corner in turn, the node on the floor."), [...pole(60, 46, "1"), ...pole(180, 46, "2"), ...pole(300, 46, "3"), ...[90, 110, 180, 200, 260, 280].map((x) => dot(x, FLOOR - 6, 5, "chosen"))]],
    lengths: ({ place }) => [t("The node on the floor, every cable taut: read the lengths."), [...pole(60, 46, "1"), ...pole(180, 46, "2"), ...pole(300, 46, "3"), ...node(110), text(110, FLOOR + 20, t("point {n}", { n: place ?? 0 }))]],
    confirm: ({ place }) => [t("A length is not the one expected there: look again."), [...pole(60, 46, "1"), ...pole(180, 46, "2"), ...pole(300, 46, "3"), ...node(130), text(230, FLOOR - 30, "?", "asked-words"), text(130, FLOOR + 20, t("point {n}", { n: place ?? 0 }))]],
    decision: ({ place }) => [t("This point does not fit the others."), [...[80, 120, 260, 290].map((x) => dot(x, FLOOR - 6, 5, "pulley")), dot(190, FLOOR - 40, 8, "chosen"), text(190, FLOOR - 56, t("point {n}", { n: place ?? 0 }))]],
    tape: ({ cable }) => [t("A mark on the cable moves along a tape."), [line(20, 60, 340, 60, "cable"), dot(70, 60, 6, "chosen"), dot(290, 60, 6, "chosen"), s("rect", { x: 40, y: 84, width: 280, height: 22, class: "tape" }), ...Array.from({ length: 14 }, (_, i) => line(50 + 20 * i, 84, 50 + 20 * i, i % 5 ? 92 : 100, "thin")), ...measure(70, 130, 290, 130, t("cable {n}", { n: cable ?? 0 }))]],
    "tape-decision": () => [t("The tape and the robot differ: read the tape again."), [line(20, 60, 340, 60, "cable"), s("rect", { x: 40, y: 84, width: 280, height: 22, class: "tape" }), text(180, 140, "?", "asked-words")]],
    finish: () => [t("The points are complete."), [...pole(60, 46, "1"), ...pole(180, 46, "2"), ...pole(300, 46, "3"), s("path", { d: "M140 112 l28 28 l58 -64", class: "done" })]],
};

/** The node in the air, with its cables, and a weight under it. */
function hanging(y: number, weight: boolean): SVGElement[] {
    return [...pole(60, 40, "1"), ...pole(300, 40, "2"), line(60, 40, 180, y, "cable"), line(300, 40, 180, y, "cable"), s("rect", { x: 169, y: y - 4, width: 22, height: 16, rx: 3, class: "node" }),
        ...(weight ? [line(180, y + 12, 180, y + 26, "thin"), dot(180, y + 32, 8, "weight")] : [])];
}

const WEIGHING: typeof STEPS = {
    weight: () => [t("A weight that is one to two times as heavy as the node."), [...hanging(70, true), text(215, 108, "? kg", "asked-words")]],
    hang: ({ place }) => [t("The node hangs still, without the weight."), [...hanging(80, false), text(180, FLOOR + 20, t("place {n}", { n: place ?? 0 }))]],
    sunk: () => [t("The weight pulls the node down: by how much?"), [...hanging(84, true), line(150, 66, 210, 66, "thin"), ...measure(240, 66, 240, 92, "? mm")]],
    motion: () => [t("The node goes up and down by 0.4 m."), [...hanging(84, false), ...measure(240, 56, 240, 112, "0.4 m")]],
    up: ({ weight }) => [t("The currents on the way up."), [...hanging(84, weight === true), ...measure(240, 112, 240, 56, "↑ ? A")]],
    down: ({ weight }) => [t("The currents on the way down."), [...hanging(84, weight === true), ...measure(240, 56, 240, 112, "↓ ? A")]],
    renew: () => [t("The measurements with the weight are complete."), [...hanging(70, true), s("path", { d: "M220 112 l20 20 l40 -44", class: "done" })]],
};

/** The drawing of a step. */
export function drawing(open: Open): SVGElement {
    const [words, parts] = (STEPS[open.kind] ?? WEIGHING[open.kind])?.(open) ?? [open.kind, []];
    const flat = ["side", "radius", "turn", "tape", "tape-decision"].includes(open.kind);
    return s("svg", { viewBox: `0 0 ${WIDE} ${HIGH}`, class: "picture", role: "img", "aria-label": words }, s("title", {}, words), ...(flat ? [] : scene()), ...parts);
}

/** By how much the ellipses are drawn larger, at most: the largest one gets this share of the drawing. */
const LARGEST = 0.12;

/** The site from above: poles with the ellipses that contain them with 95 %, points, the next place, the best one. */
export function siteDrawing(map: SiteMap): SVGElement {
    const all = [...map.anchors_m.map(([x, y]) => [x, y]), ...map.points_m, ...(map.next_m ? [map.next_m] : [])] as [number, number][];
    if (map.anchors_m.length === 0) return s("svg", { viewBox: "0 0 300 60", class: "picture" }, text(150, 34, t("nothing is measured yet")));
    const [xs, ys] = [all.map(([x]) => x), all.map(([, y]) => y)];
    const [low, high] = [[Math.min(...xs), Math.min(...ys)] as const, [Math.max(...xs), Math.max(...ys)] as const];
    const size = Math.max(high[0] - low[0], high[1] - low[1], 1), margin = 0.2 * size, scale = 400 / (size + 2 * margin);
    const place = ([x, y]: readonly [number, number]): [number, number] => [(x - low[0] + margin) * scale, (high[1] - y + margin) * scale];
    const [width, height] = [(high[0] - low[0] + 2 * margin) * scale, (high[1] - low[1] + 2 * margin) * scale];
    const largest = Math.max(...map.known.map((one) => one.half_axes_m[0]), 1e-6);
    const times = [1, 2, 5, 10, 20, 50, 100, 200, 500].findLast((times) => times * largest <= LARGEST * size) ?? 1;
    const outline = map.anchors_m.length > 2 ? [s("polygon", { points: map.anchors_m.map(([x, y]) => place([x, y]).join()).join(" "), class: "outline" })] : map.anchors_m.length === 2 ? [line(...place([map.anchors_m[0]![0], map.anchors_m[0]![1]]), ...place([map.anchors_m[1]![0], map.anchors_m[1]![1]]), "outline")] : [];
    const ellipses = map.known.map((one, i) => {
        const [x, y] = place([map.anchors_m[i]![0], map.anchors_m[i]![1]]);
        return s("ellipse", { cx: x, cy: y, rx: Math.max(one.half_axes_m[0] * times * scale, 1), ry: Math.max(one.half_axes_m[1] * times * scale, 1), transform: `rotate(${(-one.angle_rad * 180) / Math.PI} ${x} ${y})`, class: "ellipse" });
    });
    const poles = map.anchors_m.flatMap(([x, y], i) => { const at = place([x, y]); return [dot(...at, 6, "pulley"), text(at[0], at[1] - 14, String(i + 1))]; });
    const points = map.points_m.map((at) => dot(...place(at), 4, "node"));
    const next = map.next_m ? [dot(...place(map.next_m), 9, "asked-ring")] : [];
    const best = map.best ? cross(place(map.best.at_m)) : [];
    const words = map.known.length ? [text(width / 2, height - 8, times > 1 ? t("ellipses: 95 %, drawn {n} times as large", { n: times }) : t("ellipses: 95 %"))] : [];
    return s("svg", { viewBox: `0 0 ${width.toFixed(0)} ${height.toFixed(0)}`, class: "picture plan", role: "img", "aria-label": t("the site from above") }, ...outline, ...ellipses, ...points, ...next, ...best, ...poles, ...words);
}

const cross = ([x, y]: [number, number]): SVGElement[] => [line(x - 9, y - 9, x + 9, y + 9, "asked"), line(x - 9, y + 9, x + 9, y - 9, "asked")];
