// The robot from above and from the side, on a canvas; a tap is a place.

import type { Store } from "./link.js";
import type { Point } from "./protocol.js";
import { type Drawn, bounds, colours, footprint, nodeOf, tensionColour } from "./view.js";

export type Side = "top" | "side";
/** Space around the robot, px. */
const MARGIN = 34;

/** Draws the robot in two dimensions. */
export class FlatMap {
    readonly canvas = document.createElement("canvas");
    side: Side = "top";
    private scale = 1;
    private origin: [number, number] = [0, 0];

    constructor(private readonly store: Store, private readonly drawn: Drawn, tapped: (at: Partial<Record<0 | 1 | 2, number>>) => void) {
        this.canvas.className = "drawing";
        this.canvas.addEventListener("click", (event) => {
            const box = this.canvas.getBoundingClientRect();
            const [u, v] = [(event.clientX - box.left - this.origin[0]) / this.scale, -(event.clientY - box.top - this.origin[1]) / this.scale];
            tapped(this.side === "top" ? { 0: u, 1: v } : { 0: u, 2: v });
        });
    }

    private place(point: Point): [number, number] {
        const v = this.side === "top" ? point[1] : point[2];
        return [this.origin[0] + point[0] * this.scale, this.origin[1] - v * this.scale];
    }

    /** Draws again. */
    draw(): void {
        const { canvas, store: { scene, state } } = this;
        const [width, height] = [canvas.clientWidth, canvas.clientHeight], density = window.devicePixelRatio || 1;
        if (canvas.width !== Math.round(width * density) || canvas.height !== Math.round(height * density)) {
            canvas.width = Math.round(width * density);
            canvas.height = Math.round(height * density);
        }
        const pen = canvas.getContext("2d");
        if (!pen || width === 0) return;
        pen.setTransform(density, 0, 0, density, 0, 0);
        pen.clearRect(0, 0, width, height);
        if (!scene) return;
        const c = colours(), [low, high] = bounds(scene), axis = this.side === "top" ? 1 : 2;
        const spans = [high[0] - low[0], high[axis] - low[axis]];
        this.scale = Math.min((width - 2 * MARGIN) / Math.max(spans[0]!, 0.1), (height - 2 * MARGIN) / Math.max(spans[1]!, 0.1));
        this.origin = [width / 2 - (this.scale * (low[0] + high[0])) / 2, height / 2 + (this.scale * (low[axis] + high[axis])) / 2];
        this.grid(pen, c.faint, width, height);
        for (const obstacle of scene.obstacles) {
            const [bottom, top] = obstacle.height_m, foot = footprint(obstacle);
            const xs = foot.map(([x]) => x);
            const corners: Point[] = this.side === "top" ? foot.map(([x, y]): Point => [x, y, 0]) : box(Math.min(...xs), Math.max(...xs), bottom, top);
            this.shape(pen, corners, c.zone, true);
        }
        for (const [min, max] of scene.keep_out_m) {
            const corners = this.side === "top" ? [min, [max[0], min[1], 0], max, [min[0], max[1], 0]] as Point[] : box(min[0], max[0], min[2], max[2]);
            this.shape(pen, corners, c.zone, true);
        }
        this.line(pen, this.drawn.trail, c.trail, 2, []);
        for (const segment of this.store.plan?.segments ?? []) this.line(pen, segment.points_m, c.plan, 3, [8, 5]);
        this.line(pen, this.drawn.preview, c.target, 2, [3, 4]);
        const node = nodeOf(state);
        scene.anchors_m.forEach((anchor, i) => {
            if (node) this.line(pen, [anchor, node], tensionColour(state?.tensions_n?.[i], state?.slack?.[i] === 1, scene.tension_limits_n), 3, []);
            this.dot(pen, anchor, 7, c.ink);
            const [x, y] = this.place(anchor);
            pen.fillStyle = c.ink;
            pen.font = "600 14px system-ui, sans-serif";
            pen.textAlign = "center";
            pen.fillText(String(i + 1), x, y > height / 2 ? y + 24 : y - 13);
        });
        const target = this.drawn.target;
        if (target) this.cross(pen, target.at, target.possible === false ? c.bad : c.target);
        if (node) {
            const within = (state?.within_m ?? 0) * this.scale;
            this.dot(pen, node, Math.max(9, within), c.node, 0.25);
            this.dot(pen, node, 8, c.node);
        }
    }

    private grid(pen: CanvasRenderingContext2D, colour: string, width: number, height: number): void {
        const step = [0.5, 1, 2, 5, 10, 20, 50].find((step) => step * this.scale >= 42) ?? 100;
        pen.strokeStyle = pen.fillStyle = colour;
        pen.lineWidth = 1;
        pen.font = "12px system-ui, sans-serif";
        pen.textAlign = "left";
        const first = (edge: number) => Math.ceil(edge / step) * step;
        for (let u = first(-this.origin[0] / this.scale); this.origin[0] + u * this.scale < width; u += step) {
            const x = this.origin[0] + u * this.scale;
            pen.globalAlpha = 0.35;
            stroke(pen, [[x, 0], [x, height]]);
            pen.globalAlpha = 1;
            pen.fillText(`${+u.toFixed(1)}`, x + 3, height - 5);
        }
        for (let v = first((this.origin[1] - height) / this.scale); this.origin[1] - v * this.scale > 0; v += step) {
            const y = this.origin[1] - v * this.scale;
            pen.globalAlpha = 0.35;
            stroke(pen, [[0, y], [width, y]]);
            pen.globalAlpha = 1;
            if (y < height - 24) pen.fillText(`${+v.toFixed(1)} m`, 4, y - 4);
        }
    }

    private line(pen: CanvasRenderingContext2D, points: Point[], colour: string, width: number, dash: number[]): void {
        pen.strokeStyle = colour;
        pen.lineWidth = width;
        pen.setLineDash(dash);
        stroke(pen, points.map((point) => this.place(point)));
        pen.setLineDash([]);
    }

    private shape(pen: CanvasRenderingContext2D, points: Point[], colour: string, filled: boolean): void {
        pen.beginPath();
        points.forEach((point, i) => { const [x, y] = this.place(point); if (i) pen.lineTo(x, y); else pen.moveTo(x, y); });
        pen.closePath();
        pen.fillStyle = pen.strokeStyle = colour;
        pen.lineWidth = 2;
        pen.globalAlpha = 0.25;
        if (filled) pen.fill();
        pen.globalAlpha = 1;
        pen.stroke();
    }

    private dot(pen: CanvasRenderingContext2D, at: Point, radius: number, colour: string, alpha = 1): void {
        const [x, y] = this.place(at);
        pen.globalAlpha = alpha;
        pen.fillStyle = colour;
        pen.beginPath();
        pen.arc(x, y, radius, 0, 2 * Math.PI);
        pen.fill();
        pen.globalAlpha = 1;
    }

    private cross(pen: CanvasRenderingContext2D, at: Point, colour: string): void {
        const [x, y] = this.place(at);
        pen.strokeStyle = colour;
        pen.lineWidth = 3;
        stroke(pen, [[x - 14, y], [x + 14, y]]);
        stroke(pen, [[x, y - 14], [x, y + 14]]);
        pen.beginPath();
        pen.arc(x, y, 10, 0, 2 * Math.PI);
        pen.stroke();
    }
}

const box = (x0: number, x1: number, z0: number, z1: number): Point[] => [[x0, 0, z0], [x1, 0, z0], [x1, 0, z1], [x0, 0, z1]];

function stroke(pen: CanvasRenderingContext2D, points: [number, number][]): void {
    if (points.length < 2) return;
    pen.beginPath();
    points.forEach(([x, y], i) => (i ? pen.lineTo(x, y) : pen.moveTo(x, y)));
    pen.stroke();
}
