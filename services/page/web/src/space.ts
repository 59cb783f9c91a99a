// The robot in three dimensions; z is up. A tap is a place at the height of the target.

import * as three from "three";
import { OrbitControls } from "three/addons/controls/OrbitControls.js";
import type { Store } from "./link.js";
import type { Point, Scene } from "./protocol.js";
import { type Drawn, bounds, colours, footprint, nodeOf, tensionColour } from "./view.js";

/** A finger that has moved less than this has tapped, px. */
const TAP_PX = 8;

/** A line whose points change. */
class Trace {
    readonly object: three.Line;
    private key = "";

    constructor(colour: string, dashed: boolean) {
        const material = dashed ? new three.LineDashedMaterial({ color: colour, dashSize: 0.12, gapSize: 0.08 }) : new three.LineBasicMaterial({ color: colour });
        this.object = new three.Line(new three.BufferGeometry(), material);
        this.object.frustumCulled = false;
    }

    set(points: Point[], key: string): void {
        if (this.key === key) return;
        this.key = key;
        this.object.geometry.dispose();
        this.object.geometry = new three.BufferGeometry().setFromPoints(points.map((point) => new three.Vector3(...point)));
        this.object.visible = points.length > 1;
        this.object.computeLineDistances();
    }
}

/** Draws the robot in three dimensions. */
export class Space {
    readonly canvas = document.createElement("canvas");
    private readonly renderer: three.WebGLRenderer;
    private readonly camera = new three.PerspectiveCamera(45, 1, 0.05, 500);
    private readonly controls: OrbitControls;
    private world = new three.Scene();
    private built: Scene | null = null;
    /** Whether a person has chosen where to look from. */
    private moved = false;
    private theme = "";
    private cables: three.Mesh[] = [];
    private node = new three.Mesh();
    private halo = new three.Mesh();
    private target = new three.Group();
    private shadow = new three.Line();
    private traces: { trail: Trace; plan: Trace; preview: Trace } | null = null;

    /** Throws where there is no WebGL. */
    constructor(private readonly store: Store, private readonly drawn: Drawn, private readonly height: () => number, tapped: (at: Partial<Record<0 | 1 | 2, number>>) => void) {
        this.canvas.className = "drawing";
        this.renderer = new three.WebGLRenderer({ canvas: this.canvas, antialias: true, alpha: true });
        this.camera.up.set(0, 0, 1);
        this.controls = new OrbitControls(this.camera, this.canvas);
        this.controls.addEventListener("start", () => { this.moved = true; });
        this.controls.maxPolarAngle = Math.PI / 2 - 0.02;
        let down: [number, number] = [0, 0];
        this.canvas.addEventListener("pointerdown", (event) => { down = [event.clientX, event.clientY]; });
        this.canvas.addEventListener("pointerup", (event) => {
            if (Math.hypot(event.clientX - down[0], event.clientY - down[1]) > TAP_PX) return;
            const box = this.canvas.getBoundingClientRect();
            const at = new three.Vector2(((event.clientX - box.left) / box.width) * 2 - 1, 1 - ((event.clientY - box.top) / box.height) * 2);
            const ray = new three.Raycaster();
            ray.setFromCamera(at, this.camera);
            const hit = ray.ray.intersectPlane(new three.Plane(new three.Vector3(0, 0, 1), -this.height()), new three.Vector3());
            if (hit) tapped({ 0: hit.x, 1: hit.y });
        });
    }

    /** Draws again. */
    draw(): void {
        const { scene, state } = this.store, { canvas } = this;
        const [width, height] = [canvas.clientWidth, canvas.clientHeight];
        if (!scene || width === 0) return;
        const c = colours(), theme = Object.values(c).join();
        if (scene !== this.built || theme !== this.theme) this.build(scene, theme);
        this.renderer.setPixelRatio(Math.min(window.devicePixelRatio || 1, 2));
        const size = this.renderer.getSize(new three.Vector2());
        if (size.x !== width || size.y !== height) {
            this.renderer.setSize(width, height, false);
            this.camera.aspect = width / height;
            this.camera.updateProjectionMatrix();
            if (!this.moved) this.stand(scene);
        }
        const at = nodeOf(state);
        this.node.visible = this.halo.visible = this.shadow.visible = at !== null;
        if (at) {
            this.node.position.set(...at);
            this.halo.position.set(...at);
            const sigma = state?.two_sigma_m ?? [];
            this.halo.scale.set(...([0, 1, 2].map((axis) => Math.max(sigma[axis] ?? 0, 0.02)) as Point));
            this.shadow.geometry.setFromPoints([new three.Vector3(...at), new three.Vector3(at[0], at[1], scene.ground_m)]);
        }
        this.cables.forEach((cable, i) => {
            const anchor = scene.anchors_m[i];
            cable.visible = at !== null && anchor !== undefined;
            if (!at || !anchor) return;
            const [from, to] = [new three.Vector3(...anchor), new three.Vector3(...at)], along = to.clone().sub(from);
            cable.position.copy(from).addScaledVector(along, 0.5);
            cable.scale.set(1, along.length(), 1);
            cable.quaternion.setFromUnitVectors(new three.Vector3(0, 1, 0), along.normalize());
            (cable.material as three.MeshBasicMaterial).color.set(tensionColour(state?.tensions_n?.[i], state?.slack?.[i] === 1, scene.tension_limits_n));
        });
        const { trail, preview, target } = this.drawn, last = trail[trail.length - 1];
        this.traces?.trail.set(trail, `${trail.length} ${last}`);
        const planned = this.store.plan?.segments ?? [];
        this.traces?.plan.set(planned.flatMap((segment) => segment.points_m), planned.map((segment) => segment.id).join());
        this.traces?.preview.set(preview, preview.join());
        this.target.visible = target !== null;
        if (target) {
            this.target.position.set(...target.at);
            for (const child of this.target.children) ((child as three.Mesh).material as three.MeshBasicMaterial).color.set(target.possible === false ? c.bad : c.target);
        }
        this.controls.update();
        this.renderer.render(this.world, this.camera);
    }

    /** Puts the camera where every pole is seen, also on a narrow screen. */
    private stand(scene: Scene): void {
        const [low, high] = bounds(scene), span = Math.max(high[0] - low[0], high[1] - low[1], high[2] - low[2], 1);
        const middle = [0, 1, 2].map((axis) => (low[axis as 0] + high[axis as 0]) / 2) as Point;
        this.controls.target.set(middle[0], middle[1], middle[2] - 0.05 * span);
        const corners = scene.anchors_m.flatMap(([x, y, z]) => [new three.Vector3(x, y, z + 0.08 * span), new three.Vector3(x, y, scene.ground_m)]);
        for (let away = 0.6 * span; away < 6 * span; away *= 1.06) {
            this.camera.position.set(middle[0] - away * 0.22, middle[1] - away * 1.05, middle[2] + away * 0.62);
            this.camera.lookAt(this.controls.target);
            this.camera.updateMatrixWorld();
            if (corners.map((corner) => corner.clone().project(this.camera)).every(({ x, y }) => Math.abs(x) < 0.92 && Math.abs(y) < 0.84)) break;
        }
    }

    private build(scene: Scene, theme: string): void {
        const c = colours(), [low, high] = bounds(scene);
        this.world = new three.Scene();
        const [dx, dy] = [high[0] - low[0], high[1] - low[1]], span = Math.max(dx, dy, high[2] - low[2], 1);
        const middle = new three.Vector3((low[0] + high[0]) / 2, (low[1] + high[1]) / 2, (scene.ground_m + high[2]) / 2);
        const cells = Math.ceil(span * 1.4), grid = new three.GridHelper(cells, cells, c.faint, c.faint);
        grid.rotation.x = Math.PI / 2;
        grid.position.set(Math.round(middle.x), Math.round(middle.y), scene.ground_m);
        grid.material.transparent = true;
        grid.material.opacity = 0.45;
        this.world.add(grid);
        scene.anchors_m.forEach((anchor, i) => this.pole(anchor, scene.ground_m, String(i + 1), c.ink, span));
        const zone = new three.MeshBasicMaterial({ color: c.zone, transparent: true, opacity: 0.25, depthWrite: false });
        const solid = (geometry: three.BufferGeometry, at: Point) => {
            const mesh = new three.Mesh(geometry, zone);
            mesh.position.set(...at);
            const edges = new three.LineSegments(new three.EdgesGeometry(geometry, 30), new three.LineBasicMaterial({ color: c.zone }));
            edges.position.set(...at);
            this.world.add(mesh, edges);
        };
        for (const [min, max] of scene.keep_out_m) {
            const size = [0, 1, 2].map((axis) => max[axis as 0] - min[axis as 0]) as Point;
            solid(new three.BoxGeometry(...size), [0, 1, 2].map((axis) => (max[axis as 0] + min[axis as 0]) / 2) as Point);
        }
        for (const obstacle of scene.obstacles) {
            const shape = new three.Shape(footprint(obstacle).map(([x, y]) => new three.Vector2(x, y))), [bottom, top] = obstacle.height_m;
            solid(new three.ExtrudeGeometry(shape, { depth: Math.min(top, high[2] + span) - bottom, bevelEnabled: false }), [0, 0, bottom]);
        }
        this.cables = scene.anchors_m.map(() => new three.Mesh(new three.CylinderGeometry(span * 0.0022, span * 0.0022, 1, 6), new three.MeshBasicMaterial()));
        this.node = new three.Mesh(new three.SphereGeometry(span * 0.012, 24, 16), new three.MeshBasicMaterial({ color: c.node }));
        this.halo = new three.Mesh(new three.SphereGeometry(1, 24, 16), new three.MeshBasicMaterial({ color: c.node, transparent: true, opacity: 0.25, depthWrite: false }));
        this.shadow = new three.Line(new three.BufferGeometry(), new three.LineBasicMaterial({ color: c.faint }));
        this.shadow.frustumCulled = false;
        this.target = new three.Group();
        const ring = new three.Mesh(new three.TorusGeometry(span * 0.022, span * 0.003, 8, 32), new three.MeshBasicMaterial());
        const stick = new three.Mesh(new three.CylinderGeometry(span * 0.002, span * 0.002, span * 0.07, 6), new three.MeshBasicMaterial());
        stick.rotation.x = Math.PI / 2;
        this.target.add(ring, stick);
        this.traces = { trail: new Trace(c.trail, false), plan: new Trace(c.plan, true), preview: new Trace(c.target, true) };
        this.world.add(...this.cables, this.node, this.halo, this.shadow, this.target, this.traces.trail.object, this.traces.plan.object, this.traces.preview.object);
        this.built = scene;
        if (!this.moved) this.stand(scene);
        this.theme = theme;
    }

    private pole(anchor: Point, ground: number, name: string, colour: string, span: number): void {
        const height = Math.max(anchor[2] - ground, 0.01), material = new three.MeshBasicMaterial({ color: colour });
        const pole = new three.Mesh(new three.CylinderGeometry(span * 0.004, span * 0.006, height, 10), material);
        pole.rotation.x = Math.PI / 2;
        pole.position.set(anchor[0], anchor[1], ground + height / 2);
        const canvas = document.createElement("canvas");
        canvas.width = canvas.height = 64;
        const pen = canvas.getContext("2d");
        if (pen) {
            pen.font = "600 44px system-ui, sans-serif";
            pen.textAlign = "center";
            pen.textBaseline = "middle";
            pen.fillStyle = colour;
            pen.fillText(name, 32, 34);
        }
        const texture = new three.CanvasTexture(canvas);
        texture.colorSpace = three.SRGBColorSpace;
        const label = new three.Sprite(new three.SpriteMaterial({ map: texture, depthTest: false }));
        label.scale.setScalar(span * 0.07);
        label.position.set(anchor[0], anchor[1], anchor[2] + span * 0.045);
        this.world.add(pole, label);
    }
}
