// Colours and geometry that the drawings share.

import { duration } from "./dom.js";
import { t } from "./lang.js";
import type { Mission, Obstacle, Point, Scene, State } from "./protocol.js";

/** What the drawings show beside the robot. */
export interface Drawn {
    /** Where the node was, m. */
    trail: Point[];
    /** Where it is about to be sent, m, and whether it can hang there. */
    target: { at: Point; possible: boolean | null } | null;
    /** The mission that is being prepared, m. */
    preview: Point[];
}

export interface Colours { ink: string; faint: string; ground: string; node: string; trail: string; plan: string; target: string; bad: string; zone: string }

/** The colours of the theme. */
export function colours(): Colours {
    const style = getComputedStyle(document.documentElement);
    const of = (name: string) => style.getPropertyValue(name).trim();
    return { ink: of("--ink"), faint: of("--faint"), ground: of("--panel"), node: of("--node"), trail: of("--trail"), plan: of("--plan"), target: of("--target"), bad: of("--bad"), zone: of("--zone") };
}

const LOW = [31, 107, 214], HIGH = [224, 104, 0], SLACK = [128, 128, 128];

/** From blue at the least tension to orange at the largest, which colour-blind people tell apart; grey: slack. */
export function tensionColour(tension_n: number | null | undefined, slack: boolean, limits_n: [number, number]): string {
    if (slack || tension_n == null) return `rgb(${SLACK.join(",")})`;
    const share = Math.min(1, Math.max(0, (tension_n - limits_n[0]) / (limits_n[1] - limits_n[0])));
    return `rgb(${LOW.map((low, i) => Math.round(low + (HIGH[i]! - low) * share)).join(",")})`;
}

/** The corners of an obstacle's footprint. */
export function footprint(obstacle: Obstacle): [number, number][] {
    const { center_m: centre, radius_m: radius } = obstacle;
    if (!centre || radius == null) return obstacle.corners_m;
    return Array.from({ length: 24 }, (_, i): [number, number] => {
        const angle = (2 * Math.PI * i) / 24;
        return [centre[0] + radius * Math.cos(angle), centre[1] + radius * Math.sin(angle)];
    });
}

/** The lowest and the highest corner of everything, m. */
export function bounds(scene: Scene): [Point, Point] {
    const low: Point = [Infinity, Infinity, scene.ground_m], high: Point = [-Infinity, -Infinity, scene.ground_m + 1];
    for (const anchor of scene.anchors_m) for (const axis of [0, 1, 2] as const) {
        low[axis] = Math.min(low[axis], anchor[axis]);
        high[axis] = Math.max(high[axis], anchor[axis]);
    }
    return [low, high];
}

/** Position of the node as it is drawn. */
export const nodeOf = (state: State | null): Point | null => state?.position_m ?? null;

/** Keeps where the node was: a point each time it has moved. */
export function extend(trail: Point[], at: Point | null): void {
    const last = trail[trail.length - 1];
    if (!at || (last && Math.hypot(at[0] - last[0], at[1] - last[1], at[2] - last[2]) < 0.01)) return;
    trail.push(at);
    if (trail.length > 1500) trail.shift();
}

/** Whether a mission is under way, as far as the planner tells. */
export const isActive = (mission: Mission | undefined): boolean => mission !== undefined && mission.silent_s === null && ["running", "paused", "ready"].includes(mission.state);

/** What a mission does, in words. */
export function missionText(mission: Mission): string {
    const name = mission.name || t("move"), state = t(mission.state);
    if (mission.silent_s !== null) return t("{name}: nothing has come from the planner for {s} s", { name, s: mission.silent_s });
    if (!isActive(mission)) return `${name}: ${state}`;
    const { leg, legs } = mission, percent = Math.round(100 * mission.progress), left = duration(mission.time_left_s ?? 0);
    return t("{name}: {state}, leg {leg} of {legs}, {percent} %, {left} left", { name, state, leg, legs, percent, left });
}
