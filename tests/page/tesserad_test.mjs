// The page served by tesserad, with workers: a job of four tiles from the login to the 3D view, and a killed coordinator.
import assert from 'node:assert/strict';
import { execFileSync, spawn } from 'node:child_process';
import { existsSync, mkdtempSync, openSync, readFileSync, rmSync } from 'node:fs';
import { createServer } from 'node:net';
import { tmpdir } from 'node:os';
import { join } from 'node:path';
import { after, before, test } from 'node:test';
import { assertSound, findings, logIn, openPage, picture, sidewaysScroll, startBrowser } from './browser.mjs';

const programs = process.env.TESSERA_PROGRAMS, folder = mkdtempSync(join(tmpdir(), 'tessera-page-'));
const children = [], keys = join(folder, 'keys');
let browser, coordinator, address, url;

function freePort() {
  return new Promise((resolve) => {
    const server = createServer().listen(0, '127.0.0.1', () => {
      const { port } = server.address();
      server.close(() => resolve(port));
    });
  });
}

function tessera(...parameters) {
  return execFileSync(join(programs, 'tessera'), parameters, { encoding: 'utf8' });
}

function start(program, parameters, log) {
  const output = openSync(join(folder, log), 'a');
  const child = spawn(join(programs, program), parameters, { stdio: ['ignore', output, output] });
  child.ended = new Promise((resolve) => child.on('exit', resolve));
  children.push(child);
  return child;
}

async function startCoordinator() {
  const [host, port] = new URL(url).host.split(':');
  coordinator = start('tesserad', ['--data', join(folder, 'data'), '--listen', address, '--http', `${host}:${port}`, '--token-file', join(keys, 'tokens'), '--scene-root', folder], 'tesserad.log');
  for (let i = 0; i < 400; ++i) {
    if (await fetch(url).then(() => true, () => false)) return;
    assert.equal(coordinator.exitCode, null, readFileSync(join(folder, 'tesserad.log'), 'utf8'));
    await new Promise((resolve) => setTimeout(resolve, 50));
  }
  assert.fail('tesserad does not serve the page');
}

const token = (name) => readFileSync(join(keys, `${name}.token`), 'utf8').trim();

before(async () => {
  tessera('synth', join(folder, 'city'), '--toy', '--seed', '3', '--quiet');
  tessera('access', 'token', keys, 'anna:submitter', 'vera:viewer', 'olga:admin', 'rack:worker');
  address = `127.0.0.1:${await freePort()}`;
  url = `http://127.0.0.1:${await freePort()}/`;
  await startCoordinator();
  for (let i = 0; i < 2; ++i) start('tessera-worker', ['--coordinator', address, '--token-file', join(keys, 'rack.token'), '--threads', '1'], `worker${i}.log`);
  browser = await startBrowser();
});

after(async () => {
  await browser?.close();
  for (const child of children) child.kill('SIGKILL');
  await Promise.all(children.map((child) => child.ended));
  if (existsSync(folder)) rmSync(folder, { recursive: true, force: true });
});

let page;

test('a submitter logs in, gets a quote and starts a job of four tiles', async () => {
  page = await openPage(browser);
  await logIn(page, url, token('anna'));
  await page.click('nav >> text=Submit');
  await page.fill('#scene', join(folder, 'city'));
  await page.fill('#title', 'toy <img src=x onerror="window.hacked=1">');
  await page.fill('#setting-tiles', '4');
  await page.check('.box:has-text("3dtiles") input');
  await page.click('button:has-text("Get a quote")');
  await page.waitForSelector('text=Nothing has started yet');
  await picture(page, 'real_quote');
  assert.deepEqual(await findings(page), []);
  await page.click('button:has-text("Start the job")');
  await page.waitForSelector('h1:has-text("toy <img")');
  await page.waitForFunction(() => document.querySelectorAll('g.tile').length === 4, null, { timeout: 60_000 });
  await picture(page, 'real_running');
  await assertSound(page, 'job');
});

test('the coordinator is killed: the page says so, and goes on by itself', async () => {
  const before = page.url();
  coordinator.kill('SIGKILL');
  await coordinator.ended;
  await page.waitForSelector('.away:has-text("has not answered since")');
  await startCoordinator();
  await page.waitForSelector('.away', { state: 'hidden' });
  await page.waitForSelector('.badge.running, .badge.succeeded');
  assert.equal(page.url(), before);
  await page.waitForSelector('h1 .badge.succeeded', { timeout: 180_000 });
  await page.waitForFunction(() => document.querySelectorAll('g.tile[aria-label$=", done"]').length === 4);
  await page.click('g.tile >> nth=0');
  await page.waitForSelector('.attempts li');
  await page.waitForSelector('.cameras circle');
  await picture(page, 'real_done');
  for (const [section, selector] of [['timeline', '.strip canvas'], ['energy', 'svg.plot'], ['files', 'a:has-text("mesh.ply")'], ['details', '.facts-table']]) {
    await page.goto(`${url}#/jobs/1/${section}`);
    await page.waitForSelector(selector);
    assert.deepEqual(await findings(page), [], section);
    await picture(page, `real_${section}`);
  }
  await assertSound(page, 'done');
});

test('the result in 3D, with start and result', async () => {
  await page.goto(`${url}#/jobs/1`);
  await page.click('text=Result in 3D');
  const begin = Date.now();
  await page.waitForSelector('.result[data-loading="false"]');
  console.log(`first picture: ${Date.now() - begin} ms, ${await page.textContent('.status')}`);
  await picture(page, 'real_3d');
  for (const mode of ['Confidence', 'Displacement']) await page.waitForSelector(`.choices label:has-text("${mode}")`);
  const box = await page.locator('.holder canvas').boundingBox();
  await page.fill('.wipe input', '0');
  await page.mouse.click(box.x + 0.5 * box.width, box.y + 0.55 * box.height);
  await page.waitForSelector('[data-key="hit"] dt:has-text("Tile")');
  const facts = await page.textContent('[data-key="hit"]');
  assert.match(facts, /Surfaceresult/);
  assert.match(facts, /Tiletile [0-3]/);
  assert.match(facts, /Displacement\d/);
  await page.click('button:has-text("find it in mesh.ply")');
  await page.waitForFunction(() => /Input face\d/.test(document.querySelector('[data-key="hit"]')?.textContent ?? ''));
  await page.selectOption('#camera-tile', '0');
  await page.waitForSelector('text=cameras are drawn');
  await page.waitForTimeout(500);
  await picture(page, 'real_3d_cameras');
  await page.fill('.wipe input', '100');
  await page.waitForTimeout(500);
  await picture(page, 'real_3d_start');
  await assertSound(page, '3d');
});

test('each role has only its own buttons, and a phone shows the job without scrolling sideways', async () => {
  await page.context().close();
  for (const [name, buttons] of [['vera', []], ['anna', []], ['olga', ['Delete…']]]) {
    page = await openPage(browser, { viewport: { width: 360, height: 740 }, isMobile: true });
    await logIn(page, url, token(name));
    await page.click('a.title');
    await page.waitForSelector('g.tile');
    assert.deepEqual(await page.locator('.head .buttons button').allTextContents(), buttons, name);
    assert.equal(await sidewaysScroll(page), 0);
    await page.goto(`${url}#/workers`);
    await page.waitForSelector('tbody tr');
    await picture(page, `real_phone_workers_${name}`);
    await assertSound(page, name);
    await page.context().close();
  }
});
