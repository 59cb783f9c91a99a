// Walks through the page in a real browser, as a person with a tablet does: opens it, pairs, arms, zeroes, flies to a
// tapped point, and stops. The caller has started a robot with its gateway and its page.
//
//     node walk.mjs ADDRESS CODE [FOLDER]      FOLDER: for pictures of each view in three sizes, bright and dark

import assert from "node:assert/strict";
import { mkdirSync } from "node:fs";
import { chromium } from "playwright-core";

const [address, code, folder] = process.argv.slice(2);
const START = [4.8, 3.0, 0.3];
// Longest wait for an event, ms: the machine may stand still for seconds.
const LONG = 60_000;
const SIZES = { phone: [390, 844], tablet: [820, 1180], desk: [1400, 900] };
const VIEWS = ["Fly", "Missions", "Charts", "Runs", "Robot"];

const browser = await chromium.launch({
    executablePath: process.env.NIMS_CHROMIUM ?? "/usr/bin/chromium",
    args: ["--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--ignore-gpu-blocklist"],
});
const context = await browser.newContext({ viewport: { width: 820, height: 1180 }, hasTouch: true, ignoreHTTPSErrors: true });
context.setDefaultTimeout(LONG);
const page = await context.newPage();
// A gamepad, which Chromium cannot emulate: what the page reads of it.
await page.addInitScript(() => {
    window.pad = { connected: true, axes: [0, 0, 0, 0], buttons: Array.from({ length: 17 }, () => ({ pressed: false })) };
    navigator.getGamepads = () => [window.pad];
});
const wrong = [];
page.on("console", (message) => { if (message.type() === "error") wrong.push(message.text()); });
page.on("pageerror", (error) => wrong.push(String(error)));
page.on("dialog", (dialog) => dialog.accept());
const mode = async (name) => {
    try {
        await page.locator(`.mode[data-mode="${name}"]`).waitFor();
    } catch (error) {
        throw new Error(`${name} is not reached; the page shows:\n${await page.evaluate(() => document.body.innerText)}`, { cause: error });
    }
};
const press = (name) => page.getByRole("button", { name, exact: true }).filter({ visible: true }).first().click();
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

await press("Arm");
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

// The node moves while a button is held, and while a stick is; button B of the gamepad stops.
const up = await page.getByRole("button", { name: "up: z grows, while held" }).boundingBox();
assert.ok(up);
await page.mouse.move(up.x + up.width / 2, up.y + up.height / 2);
await hold("moves while a button is held", () => page.mouse.down(), () => page.mouse.up());
const stick = (value) => page.evaluate((value) => { window.pad.axes[3] = value; }, value);
await hold("moves while a stick is held", () => stick(-1), () => stick(0));
await begin("Go there");
await page.evaluate(() => { window.pad.buttons[1].pressed = true; });
await mode("holding");
await page.evaluate(() => { window.pad.buttons[1].pressed = false; });
said("stopped by the gamepad");

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

// The charts begin before this page was opened: with the time in which the visitor looked.
await page.getByRole("tab", { name: "Charts" }).click();
await page.locator(".chart canvas").first().waitFor();
assert.equal(await page.locator(".chart").count(), 5);
said("charts");

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
    await Promise.all([page.waitForEvent("load"), page.locator("select").filter({ visible: true }).selectOption(language)]);
    await page.locator(`html[lang="${language}"]`).waitFor();
    await page.locator('.mode[data-mode="holding"]').waitFor();
};
for (const language of ["de", "es", "fr", "en"]) {
    await choose(language);
    for (const width of language === "en" ? [360, ...Object.values(SIZES).map(([width]) => width)] : [360, SIZES.desk[0]]) {
        await page.setViewportSize({ width, height: 844 });
        for (const tab of await page.getByRole("tab").all()) {
            await tab.click();
            // Two frames, in which the drawings take their new sizes.
            await page.evaluate(() => new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done))));
            const cut = await page.evaluate(() => [...document.querySelectorAll("body *")].filter((one) => one.clientWidth > 0 && getComputedStyle(one).display !== "inline" && !one.matches("input, textarea, canvas") && one.scrollWidth > one.clientWidth + 1).map((one) => `${one.tagName}.${one.className} ${one.textContent?.slice(0, 40)}`));
            assert.deepEqual(cut, [], `${language}, ${await tab.innerText()} at ${width} px`);
        }
    }
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
said("nothing is cut at 360 px and above, in four languages");

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
                await page.screenshot({ path: `${folder}/${view.toLowerCase()}-${size}-${theme}.png` });
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
