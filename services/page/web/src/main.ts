// The page: one screen with a line at the top, a view, and STOP below it.

import { Charts } from "./charts.js";
import { h } from "./dom.js";
import { fit } from "./fit.js";
import { Fly } from "./fly.js";
import { Head } from "./head.js";
import { Conversation, Store } from "./link.js";
import { t } from "./lang.js";
import { Missions } from "./missions.js";
import { RobotView } from "./robot.js";
import { Runs } from "./runs.js";
import { SetUp } from "./setup.js";
import { Stop } from "./stop.js";

/** Time between two drawings, ms: the state comes 20 times per second. */
const DRAW_MS = 50;

const store = new Store();
const conversation = new Conversation(store);
const head = new Head(store, conversation);
const fly = new Fly(store, conversation);
const missions = new Missions(store, conversation, fly.drawn);
const setup = new SetUp(store, conversation);
const charts = new Charts(store, conversation);
const runs = new Runs(store, conversation);
const robot = new RobotView(store, conversation);
const stop = new Stop(conversation);

const views: Record<string, { element: HTMLElement; draw: (visible: boolean) => void; shown?: () => void }> = {
    Fly: { element: fly.element, draw: (visible) => fly.draw(visible) },
    Missions: { element: missions.element, draw: (visible) => { if (visible) missions.draw(); } },
    "Set up": { element: setup.element, draw: (visible) => { if (visible) setup.draw(); } },
    Charts: { element: charts.element, draw: (visible) => charts.draw(visible) },
    Runs: { element: runs.element, draw: () => {}, shown: () => void runs.load() },
    Robot: { element: robot.element, draw: (visible) => { if (visible) robot.draw(); } },
};
const NAMES: Record<string, string> = { Fly: t("Fly"), Missions: t("Missions"), "Set up": t("Set up"), Charts: t("Charts"), Runs: t("Runs"), Robot: t("Robot") };
let shown = "Fly";
const tabs = h("nav", { class: "tabs", role: "tablist", "aria-label": t("views") });

function show(name: string): void {
    shown = name;
    for (const [other, view] of Object.entries(views)) view.element.hidden = other !== name;
    for (const tab of tabs.children) tab.setAttribute("aria-selected", String((tab as HTMLElement).dataset.view === name));
    views[name]?.shown?.();
}

for (const name of Object.keys(views)) tabs.append(h("button", { type: "button", role: "tab", "data-view": name, click: () => show(name) }, NAMES[name] ?? name));
document.querySelector(".early")?.remove();
document.body.append(head.element, h("main", {}, ...Object.values(views).map((view) => view.element)), head.note, stop.said, tabs, stop.element);
fit();
show(shown);

let drawnAt = -Infinity;
function frame(now: number): void {
    if (now - drawnAt >= DRAW_MS - 5) {
        drawnAt = now;
        head.draw();
        for (const [name, view] of Object.entries(views)) view.draw(name === shown);
    }
    requestAnimationFrame(frame);
}
requestAnimationFrame(frame);
