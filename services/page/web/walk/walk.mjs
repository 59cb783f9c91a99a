// Walks through the page in a real browser, as a person with a tablet does: opens it, pairs, arms, zeroes, flies to a
// tapped point, and stops. The caller has started a robot with its gateway and its page.
//
//     node walk.mjs ADDRESS CODE [FOLDER]      FOLDER: for pictures of each view in three sizes, bright and dark

import assert from "node:assert/strict";
import { mkdirSync } from "node:fs";
import { readFile } from "node:fs/promises";
import { chromium } from "playwright-core";

const [address, code, folder] = process.argv.slice(2);
const START = [4.8, 3.0, 0.3];
// Longest wait for an event, ms: the machine may stand still for seconds.
const LONG = 60_000;
const SIZES = { phone: [390, 844], tablet: [820, 1180], desk: [1400, 900] };
const VIEWS = ["Fly", "Missions", "Set up", "Charts", "Runs", "Robot"];

const browser = await chromium.launch({
    executablePath: process.env.NIMS_CHROMIUM ?? "/usr/bin/chromium",
    args: ["--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--ignore-gpu-blocklist"],
});
const context = await browser.newContext({ viewport: { width: 820, height: 1180 }, hasTouch: true, ignoreHTTPSErrors: true });
context.setDefaultTimeout(LONG);
const page = await context.newPage();
// A gamepad, which Chromium cannot emulate: what the page reads of it. And the number of stops that it sends.
await page.addInitScript(() => {
    window.pad = { connected: true, axes: [0, 0, 0, 0], buttons: Array.from({ length: 17 }, () => ({ pressed: false })) };
    navigator.getGamepads = () => [window.pad];
    window.stops = 0;
    const { send } = WebSocket.prototype;
    WebSocket.prototype.send = function (data) {
        if (String(data).includes('"verb":"stop"')) window.stops += 1;
        return send.call(this, data);
    };
});
const wrong = [];
page.on("console", (message) => { if (message.type() === "error") wrong.push(message.text()); });
page.on("pageerror", (error) => wrong.push(String(error)));
// During a dialog of the browser nothing stops.
page.on("dialog", (dialog) => { wrong.push(`a dialog stops the page: ${dialog.message()}`); void dialog.accept(); });
const mode = async (name) => {
    try {
        await page.locator(`.mode[data-mode="${name}"]`).waitFor();
    } catch (error) {
        throw new Error(`${name} is not reached; the page shows:\n${await page.evaluate(() => document.body.innerText)}`, { cause: error });
    }
};
// Actions that have just changed take no tap.
const press = async (name) => {
    await page.locator(".row.new").filter({ visible: true }).waitFor({ state: "detached" });
    await page.getByRole("button", { name, exact: true }).filter({ visible: true }).first().click();
};
// Begins a motion. Just after another one the planner may not have seen its end, and refuses: a person tries again.
const begin = async (name) => {
    const following = page.locator('.mode[data-mode="following"]'), begun = Date.now();
    for (;;) {
        await press(name);
        const flies = await following.waitFor({ timeout: 2000 }).then(() => true, () => false);
        if (flies) return;
        console.log(`again: ${await page.locator(".answer:visible").allInnerTexts()}`);
        assert.ok(Date.now() - begun < LONG, `${name}: in vain`);
    }
};
// Holds a control until the robot moves. On a machine that stands still the signs come too late, and the motion ends or is
// refused: a person presses again.
const hold = async (name, down, up) => {
    const following = page.locator('.mode[data-mode="following"]'), begun = Date.now();
    for (;;) {
        await down();
        const flies = await following.waitFor({ timeout: 4000 }).then(() => true, () => false);
        if (flies) break;
        console.log(`again: ${name}: ${await page.locator(".answer:visible").allInnerTexts()}`);
        await up();
        assert.ok(Date.now() - begun < LONG, `${name}: in vain`);
        await mode("holding");
    }
    await up();
    await mode("holding");
    said(name);
};
const said = (name) => console.log(`walked: ${name}`);

// STOP is there before the script is.
await page.route("**/page.js", (route) => route.abort());
await page.goto(`${address}/`);
await page.locator(".early .stop").click();
await page.locator("#answer").waitFor();
await page.unroute("**/page.js");
wrong.length = 0;
said("STOP without the script");

// A visitor looks and stops.
await page.goto(`${address}/`);
await mode("disarmed");
await page.getByText("may stop").waitFor();
const painted = await page.evaluate(() => performance.getEntriesByName("first-contentful-paint")[0]?.startTime ?? NaN);
console.log(`first paint after ${Math.round(painted)} ms`);
assert.equal(await page.getByRole("button", { name: "Arm", exact: true }).count(), 0, "a visitor cannot arm");
said("a visitor looks");

// The address that `nims page pair` prints pairs this browser; its code leaves the address bar and works once.
await page.goto("about:blank");
await page.goto(`${address}/#code=${code}`);
await page.getByText("may fly").waitFor();
assert.ok(!page.url().includes(code), page.url());
said("paired");

// What appears under a finger is not pressed by it.
const early = page.evaluate(() => new Promise((done) => {
    const look = () => {
        const disarm = [...document.querySelectorAll("button")].find((one) => one.textContent === "Disarm");
        if (!disarm) return void requestAnimationFrame(look);
        disarm.click();
        done(document.querySelectorAll(".asks").length);
    };
    look();
}));
await press("Arm");
assert.equal(await early, 0);
await mode("holding");
const aim = async (point) => {
    for (const [i, name] of ["x", "y", "z"].entries()) {
        const field = page.getByLabel(`${name} of the target in metres`);
        await field.fill(String(point[i]));
        await field.press("Tab");
    }
};
await aim(START);
await press("The node is at …");
await press("Yes");
await page.waitForFunction(() => document.querySelector(".big")?.textContent?.startsWith("4.8"));
said("zeroed");

// A point is tapped in the drawing from above; its height is set; the finding comes before it can be flown to.
await press("Top");
const drawing = page.locator("canvas.drawing:visible");
const box = await drawing.boundingBox();
assert.ok(box);
await page.touchscreen.tap(box.x + box.width * 0.56, box.y + box.height * 0.55);
await page.getByText("The node can hang there").waitFor();
const slider = page.getByLabel("height of the target");
await slider.fill("0.7");
await page.locator("p.good:has-text('The node can hang there')").waitFor();
await begin("Go there");
said("flies to a tapped point");

// The space bar stops, wherever the focus is.
await page.keyboard.press("Space");
await mode("holding");
said("stopped by the space bar");

// A question that is open stops nothing: STOP acts, by touch and by the space bar, and it stays open.
const asks = page.getByRole("alertdialog");
// Flies to a point that is not where the node is: a slow machine lets a flight end before it is stopped.
const fly = async (point) => {
    await aim(point);
    await page.locator("p.good:has-text('The node can hang there')").waitFor();
    await begin("Go there");
};
for (const [point, stop] of [[[4.0, 2.6, 0.5], () => page.locator("#stop").tap()], [[5.6, 3.8, 0.8], () => page.keyboard.press("Space")]]) {
    await fly(point);
    await page.getByRole("tab", { name: "Robot" }).click();
    await press("Restart planner");
    await asks.waitFor();
    await stop();
    // What became of it is told in every view.
    await page.locator(".stop-said:not(.refused)").waitFor();
    await mode("holding");
    assert.equal(await asks.count(), 1);
    await press("Cancel");
    assert.equal(await asks.count(), 0);
    await page.getByRole("tab", { name: "Fly" }).click();
}
said("stopped while a question is open");

// The node moves while a button is held, and while a stick is; button B of the gamepad stops.
// It moves on the screen with the texts above it.
const up = page.getByRole("button", { name: "up: z grows, while held" });
const down = async () => { await up.hover(); await page.mouse.down(); };
await hold("moves while a button is held", down, () => page.mouse.up());
// A phone that is turned meanwhile ends it: the button is no more under the finger.
await page.setViewportSize({ width: 390, height: 844 });
await hold("a held motion ends when the phone is turned", down, async () => { await page.setViewportSize({ width: 844, height: 390 }); await mode("holding"); await page.mouse.up(); });
await page.setViewportSize({ width: 820, height: 1180 });
await press("The node is at …");
await asks.waitFor();
await hold("moves while a button is held and a question is open", down, () => page.mouse.up());
await press("Cancel");
const stick = (value) => page.evaluate((value) => { window.pad.axes[3] = value; }, value);
await hold("moves while a stick is held", () => stick(-1), () => stick(0));
await fly([4.0, 2.6, 0.5]);
// Pressed until the page has seen it, and no longer: held for a second it is the emergency stop.
await page.evaluate(async () => {
    window.pad.buttons[1].pressed = true;
    while (!document.querySelector("#stop.pressed")) await new Promise((done) => setTimeout(done, 5));
    window.pad.buttons[1].pressed = false;
});
await mode("holding");
said("stopped by the gamepad");

// A press whose end was not seen takes no later one: each is sent. What is held when the page loses the keyboard is no
// emergency stop.
const sent = await page.evaluate(() => {
    const before = window.stops, down = () => document.body.dispatchEvent(new KeyboardEvent("keydown", { code: "Space", bubbles: true, cancelable: true }));
    down();
    down();
    window.dispatchEvent(new Event("blur"));
    return window.stops - before;
});
assert.equal(sent, 2);
// Held for a second it would be one.
await page.waitForTimeout(1500);
assert.equal(await page.locator(".mode").getAttribute("data-mode"), "holding");
assert.equal(await page.locator("#stop .stop-word").innerText(), "STOP");
said("a press whose end is lost");

// A raster is written by the form, checked, flown, paused, resumed and stopped.
await page.getByRole("tab", { name: "Missions" }).click();
await press("Around the node");
await page.getByText("The node can hang at each of").waitFor();
await begin("Fly it");
await press("Pause");
await mode("holding");
await begin("Resume");
await page.locator("#stop").tap();
await mode("holding");
said("a raster is flown, paused, resumed and stopped");

// The charts begin before this page was opened: with the time in which the visitor looked. Any number is drawn too, and
// what happened is listed.
await page.getByRole("tab", { name: "Charts" }).click();
await page.locator(".chart canvas").first().waitFor();
assert.equal(await page.locator(".chart").count(), 5);
await page.getByLabel("channel").locator("option", { hasText: "motor/state" }).first().waitFor({ state: "attached" });
await page.getByLabel("channel").selectOption("motor/state");
await page.getByLabel("number", { exact: true }).selectOption("length_m 2");
await press("Draw it");
await page.locator(".chart canvas").nth(5).waitFor();
await page.locator(".log .of-request", { hasText: "tablet@" }).first().waitFor();
said("charts");

// A site is set up by a person who mistypes: the refusals are those of `nims setup`.
await page.getByRole("tab", { name: "Set up" }).click();
const open = () => page.locator(".step").getAttribute("data-key");
const moves = async (act) => {
    const before = await open();
    await act();
    await page.waitForFunction((before) => document.querySelector(".step")?.dataset.key !== before, before);
};
const type = async (line) => {
    await page.getByLabel("answer", { exact: true }).filter({ visible: true }).fill(line);
    await press("Answer");
};
const answer = async (line, kind) => {
    if (kind === null) {
        await type(line);
        await page.locator(".answer.refused:visible").waitFor();
    } else {
        await moves(() => type(line));
        assert.ok((await open()).includes(`"kind":"${kind}"`), `${line} leads to ${await open()}`);
    }
};
// Poles at (0, 0), (8, 0) and (8, 6), the pulleys 3 m above the floor.
const SITE = [[0, 0, 3], [8, 0, 3], [8, 6, 3]];
const length = (at) => SITE.map(([x, y, z]) => Math.hypot(x - at[0], y - at[1], z).toFixed(3)).join(" ");
await page.locator(".picture").first().waitFor();
await answer("some", null);
await answer("3", "distance");
await answer("8,oo", null);
for (const [line, kind] of [["8.0", "distance"], ["1000 cm", "distance"], ["600 cm", "side"]]) await answer(line, kind);
await moves(() => press("left"));
await answer("3000", null);
for (const [line, kind] of [["3", "height"], ["3,0", "height"], ["300 cm", "radius"], ["", "points"], ["", "lengths"]]) await answer(line, kind);
await page.locator(".site .asked-ring").waitFor();
for (const at of [[0.5, 0.2], [7.7, 0.3], [7.8, 5.6], [1, 0.5], [7.5, 0.6], [7.4, 5.3], [1.4, 0.7], [7.2, 0.9], [7.1, 5.0]]) {
    await moves(() => type(length(at)));
    // Lengths far from those of the planned place are asked about.
    if ((await open()).includes('"confirm"')) await moves(() => press("It is right"));
    if (folder && at[0] === 7.5) {
        mkdirSync(folder, { recursive: true });
        await page.screenshot({ path: `${folder}/set-up-points-tablet.png` });
    }
}
await page.locator(`.step[data-key*='"kind":"finish"']`).waitFor();
assert.equal(await page.locator(".site .ellipse").count(), 3);
await page.locator(".site .asked").first().waitFor();
await press("Write the calibration");
const [calibration] = await Promise.all([page.waitForEvent("download"), press("site-calibration.toml")]);
const written = await readFile(await calibration.path(), "utf8");
assert.ok(written.includes("anchors_m") && written.includes("covariance_m2"), written);
const [robotFile] = await Promise.all([page.waitForEvent("download"), page.getByRole("button", { name: /^(robot|lab3).*\.toml$/ }).click()]);
assert.ok((await readFile(await robotFile.path(), "utf8")).includes('calibration = "site-calibration.toml"'));
said("a site is set up, with mistakes");

// The node is weighed by a person who mistypes. What is determined is not stored while the robot is armed.
await press("Weigh the node");
await page.locator(`.step[data-key*='"kind":"weight"']`).waitFor();
await answer("heavy", null);
for (const [line, kind] of [["2 kg", "hang"], ["5.246 6.884 6.855", "sunk"], ["63,5 mm", "hang"], ["3.840 8.001 7.987", "sunk"], ["4.6 cm", "hang"]]) await answer(line, kind);
await page.reload();
await page.getByRole("tab", { name: "Set up" }).click();
await press("Weigh the node");
await page.locator(`.step[data-key*='"kind":"hang"'][data-key*='"place":3']`).waitFor();
await moves(() => press("No more places"));
await answer("4.9 6.7 7.1", "up");
// Counting begins at a press, and not with the question.
assert.equal(await page.getByRole("button", { name: "Take the robot's currents" }).count(), 0);
await press("No weight hangs: begin");
await press("Take the robot's currents");
await page.locator(".answer.refused:visible", { hasText: "has not moved up and down" }).waitFor();
for (const [line, kind] of [["0.545 0.549 0.566", "down"], ["-0.065 -0.065 -0.063", "up"], ["1.254 1.264 1.308", "down"], ["-0.006 -0.005 -0.001", "renew"]]) await answer(line, kind);
await press("Show what is determined");
await page.locator(".verdict", { hasText: "weight of the node" }).waitFor();
const [weighed] = await Promise.all([page.waitForEvent("download"), page.getByRole("button", { name: /-loads\.toml$/ }).click()]);
assert.ok((await readFile(await weighed.path(), "utf8")).includes("[[weighing]]"));
await press("Store it on the robot");
await press("Yes");
await page.locator(".answer:visible", { hasText: "disarm the robot" }).waitFor();
if (folder) {
    mkdirSync(folder, { recursive: true });
    await page.screenshot({ path: `${folder}/set-up-weighed-tablet.png` });
}
await press("Calibrate the site");
await page.locator(`.step[data-key*='"kind":"finish"']`).waitFor();
await press("Write the calibration");
said("the node is weighed, with mistakes and a reload");

// The drives say what is to be set in their maker's program, and whether they answer.
await page.locator("p", { hasText: "in Motion Studio: packet serial mode" }).first().waitFor();
await page.locator("p", { hasText: /unit 128.*answers/ }).first().waitFor();
said("the drives");

// The robot takes the calibration when it is disarmed, and not before.
const stores = async (words) => {
    await press("Store it on the robot");
    await press("Yes");
    await page.locator(".answer:visible", { hasText: words }).waitFor();
};
await stores("disarm the robot");
await page.getByRole("tab", { name: "Fly" }).click();
await press("Disarm");
await press("Yes");
await mode("disarmed");
await page.getByRole("tab", { name: "Set up" }).click();
await stores("lab3.toml is stored");
await stores("is the same already");
await page.getByRole("tab", { name: "Fly" }).click();
await press("Arm");
await mode("holding");
await page.getByRole("tab", { name: "Set up" }).click();
said("the robot keeps the calibration");

// An answer that is under way while another site is opened belongs to its own site.
const sites = () => page.evaluate(() => JSON.parse(localStorage.getItem("nims-sites")));
const first = (await sites()).site;
await page.getByLabel("name of the site").fill("second");
await press("Open the site");
await page.locator(`.step[data-key*='"kind":"pulleys"']`).waitFor();
await page.getByLabel("answer", { exact: true }).filter({ visible: true }).fill("3");
await page.evaluate(() => {
    const press = (name) => [...document.querySelectorAll("button")].find((one) => one.textContent === name).click();
    press("Answer");
    press("site");
});
await page.locator(`.step[data-key*='"kind":"finish"']`).waitFor();
await page.getByRole("button", { name: "Delete second" }).waitFor();
assert.equal((await sites()).site, first);
assert.ok((await sites()).second.length < first.length, await sites());
await page.getByRole("button", { name: "Delete second" }).click();
await press("Yes");
await page.getByRole("button", { name: "Delete second" }).waitFor({ state: "detached" });
said("an answer stays with its site");

// A second controller is started, seen to qualify, and put in charge.
await page.getByRole("tab", { name: "Robot" }).click();
await page.getByLabel("law or method of controller b").waitFor();
await press("Start it here");
await press("Put in charge");
await press("Yes");
await page.locator("p", { hasText: /^controller b active.*in charge/ }).waitFor();
said("a controller is swapped");

// A run of before: its report is made and opens where nothing acts, a table is downloaded, and it is deleted after two
// questions.
await page.getByRole("tab", { name: "Runs" }).click();
await press("Make the report");
await page.locator(".run .good, .run .bad").first().waitFor();
const [report] = await Promise.all([context.waitForEvent("page"), press("Report")]);
await report.locator("h1").first().waitFor();
assert.equal(await report.evaluate(() => window.origin).catch(() => "null"), "null", "the report acts for the page");
await report.close();
await press("Tables as CSV");
const [table] = await Promise.all([page.waitForEvent("download"), page.getByLabel("Download export/motor.state.csv").click()]);
assert.ok((await readFile(await table.path(), "utf8")).startsWith("t_s,"));
if (folder) {
    mkdirSync(folder, { recursive: true });
    await page.screenshot({ path: `${folder}/runs-with-report.png` });
}
await press("Delete");
await press("Keep it");
await press("Delete");
await press("Delete it");
await press("Delete it for good");
await page.getByText("no finished run yet").waitFor();
said("a run is assessed, downloaded and deleted");

// STOP is at the same place on each view, and the largest control.
const places = [];
for (const view of VIEWS) {
    await page.getByRole("tab", { name: view }).click();
    const stop = await page.locator("#stop").boundingBox();
    assert.ok(stop);
    places.push(JSON.stringify(stop));
    const areas = await page.locator("button:visible:not(#stop)").evaluateAll((all) => all.map((one) => one.offsetWidth * one.offsetHeight));
    assert.ok(Math.max(...areas) < stop.width * stop.height, `${view}: a button is larger than STOP`);
}
assert.equal(new Set(places).size, 1, places.join("\n"));
said("STOP is the largest control, at one place");

// Nothing is cut or wider than the screen from 360 px on, in any language.
const choose = async (language) => {
    await page.getByRole("tab").last().click();
    await Promise.all([page.waitForEvent("load"), page.locator("select").filter({ visible: true }).first().selectOption(language)]);
    await page.locator(`html[lang="${language}"]`).waitFor();
    await page.locator('.mode[data-mode="holding"]').waitFor();
};
const cuts = [];
for (const language of ["de", "es", "fr", "en"]) {
    await choose(language);
    for (const width of language === "en" ? [360, ...Object.values(SIZES).map(([width]) => width)] : [360, SIZES.desk[0]]) {
        await page.setViewportSize({ width, height: 844 });
        for (const tab of await page.getByRole("tab").all()) {
            await tab.click();
            // Two frames, in which the drawings take their new sizes.
            await page.evaluate(() => new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done))));
            const cut = await page.evaluate(() => [...document.querySelectorAll("body *")].filter((one) => one.clientWidth > 0 && getComputedStyle(one).display !== "inline" && !one.matches("input, textarea, canvas, svg *") && one.scrollWidth > one.clientWidth + 1).map((one) => `${one.tagName}.${one.className} ${one.textContent?.slice(0, 40)}`));
            cuts.push(...cut.map((what) => `${language} at ${width} px: ${what}`));
        }
    }
    // The guided calibration asks in the language of the browser: its question and its refusal are not the English ones.
    await page.getByRole("tab").nth(VIEWS.indexOf("Set up")).click();
    const asked = page.locator(".question:visible");
    await asked.filter({ hasText: { de: "„Kalibrierung schreiben“ drücken", es: "Pulse «Escribir la calibración»", fr: "Appuyer sur « Écrire la calibration »", en: 'Press "Write the calibration"' }[language] }).waitFor();
    // So is the verdict, with its figures.
    await asked.filter({ hasText: { de: /Anker 1: x.*die unsicherste Koordinate ist/s, es: /anclaje 1: x.*la coordenada menos segura es/s, fr: /ancrage 1 : x.*la coordonnée la moins sûre est/s, en: /anchor 1: x.*the least certain coordinate is/s }[language] }).waitFor();
    await page.locator("form input:visible").first().fill("many");
    await page.locator("form button.main:visible").first().click();
    await page.locator(".answer.refused:visible", { hasText: { de: "ist keine Zahl weiterer Punkte", es: "no es un número de puntos", fr: "n'est pas un nombre de points", en: "is not a number of further points" }[language] }).waitFor();
    if (language === "de") {
        await page.getByRole("tab", { name: "Fliegen" }).click();
        assert.equal(await page.getByRole("button", { name: "Scharf schalten" }).count(), 0);
        await page.getByRole("button", { name: "Abschalten" }).waitFor();
    }
    if (folder) {
        mkdirSync(folder, { recursive: true });
        await page.setViewportSize({ width: 390, height: 844 });
        await page.getByRole("tab").first().click();
        await page.screenshot({ path: `${folder}/fly-phone-${language}.png` });
    }
}
assert.deepEqual(cuts, []);
// A phone on its side: STOP beside the view, which keeps most of the height.
await page.setViewportSize({ width: 844, height: 390 });
for (const tab of await page.getByRole("tab").all()) {
    await tab.click();
    const [view, field] = [await page.locator("main").boundingBox(), await page.locator("#stop").boundingBox()];
    assert.ok(view && field && view.height > 170 && field.height > 300 && field.x > view.x + view.width - 20, JSON.stringify([view, field]));
    if (folder) await page.screenshot({ path: `${folder}/landscape-${await tab.getAttribute("data-view")}.png` });
}
said("nothing is cut at 360 px and above, and the questions of a site, in four languages");

// A keyboard on the screen, as Safari shows it: over the page, which it moves. STOP is above it, and the field too.
await page.setViewportSize({ width: 390, height: 844 });
const keyboard = (seen) => page.evaluate((seen) => {
    const { visualViewport } = window;
    for (const name of ["height", "offsetTop"]) delete visualViewport[name];
    for (const [name, value] of Object.entries(seen)) Object.defineProperty(visualViewport, name, { get: () => value, configurable: true });
    visualViewport.dispatchEvent(new Event("resize"));
}, seen);
await keyboard({ height: 420, offsetTop: 100 });
const [above, typed] = [await page.locator("#stop").boundingBox(), await page.locator("main").boundingBox()];
assert.ok(above && typed && above.y + above.height <= 520 && typed.y >= 100 && typed.height > 200, JSON.stringify([above, typed]));
if (folder) await page.screenshot({ path: `${folder}/keyboard.png` });
await keyboard({});
said("STOP above a keyboard");

if (folder) {
    mkdirSync(folder, { recursive: true });
    await page.getByRole("tab", { name: "Fly" }).click();
    await aim([5.4, 3.6, 0.7]);
    await page.locator("p.good:has-text('The node can hang there')").waitFor();
    await begin("Go there");
    for (const theme of ["bright", "dark"]) {
        await page.evaluate((theme) => { document.documentElement.dataset.theme = theme; }, theme);
        for (const [size, [width, height]] of Object.entries(SIZES)) {
            await page.setViewportSize({ width, height });
            for (const view of VIEWS) {
                await page.getByRole("tab", { name: view }).click();
                if (view === "Fly") await press("3-D");
                await page.waitForTimeout(400);
                await page.screenshot({ path: `${folder}/${view.toLowerCase().replace(" ", "-")}-${size}-${theme}.png` });
            }
        }
    }
}

// Held for a second STOP is the emergency stop; a reset leads on.
await page.setViewportSize({ width: 820, height: 1180 });
await page.getByRole("tab", { name: "Fly" }).click();
const stop = await page.locator("#stop").boundingBox();
assert.ok(stop);
await page.mouse.move(stop.x + stop.width / 2, stop.y + stop.height / 2);
await page.mouse.down();
await mode("emergency stop");
await page.mouse.up();
await press("Reset");
await mode("holding");
said("the emergency stop and its reset");

assert.deepEqual(wrong, [], "the browser reports errors");
await browser.close();
