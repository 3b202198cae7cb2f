// Chromium for the tests, what they ask of every view, and pictures of the views.
import assert from 'node:assert/strict';
import { readFileSync } from 'node:fs';
import { createRequire } from 'node:module';
import { join } from 'node:path';

export const tools = process.env.TESSERA_PAGE_TOOLS, builtPage = process.env.TESSERA_PAGE;
const require = createRequire(join(tools, 'package.json'));
const { chromium } = require('playwright-core');
const axeSource = readFileSync(require.resolve('axe-core/axe.min.js'), 'utf8');

// `webgl`: by SwiftShader, on the processor; false starts a browser that refuses it.
export function startBrowser(webgl = true) {
  const args = ['--no-sandbox', '--disable-gpu', webgl ? '--enable-unsafe-swiftshader' : '--disable-3d-apis'];
  return chromium.launch({ executablePath: process.env.CHROMIUM ?? '/usr/bin/chromium', args });
}

// A page that fails the test at any error of its scripts and any violation of the content security policy.
export async function openPage(browser, options = {}) {
  const context = await browser.newContext({ viewport: { width: 1280, height: 800 }, ...options });
  const page = await context.newPage();
  page.setDefaultTimeout(20_000);
  page.faults = [];
  page.on('pageerror', (error) => page.faults.push(error.stack ?? error.message));
  page.on('console', (message) => { if (/Content Security Policy|violates/.test(message.text())) page.faults.push(message.text()); });
  return page;
}

export async function logIn(page, url, token) {
  await page.goto(url);
  await page.fill('#token', token);
  await page.keyboard.press('Enter');
  await page.waitForSelector('.jobs tbody tr, .jobs .empty');
}

export function picture(page, name, options = {}) {
  return page.screenshot({ path: join(tools, 'pictures', `${name}.png`), ...options });
}

// Serious and critical findings of axe-core. The debugger's protocol runs its source, which the page's policy would refuse.
export async function findings(page) {
  const client = await page.context().newCDPSession(page);
  await client.send('Runtime.evaluate', { expression: axeSource });
  await client.detach();
  const violations = await page.evaluate(async () => (await window.axe.run(document, { resultTypes: ['violations'] })).violations);
  return violations.filter(({ impact }) => impact === 'serious' || impact === 'critical')
    .map(({ id, nodes }) => `${id}: ${nodes.map((node) => `${node.target.join(' ')}: ${node.failureSummary}`).join('; ')}`);
}

export async function sidewaysScroll(page) {
  return page.evaluate(() => document.documentElement.scrollWidth - document.documentElement.clientWidth);
}

// No name became an element or ran, and nothing went wrong so far.
export async function assertSound(page, where) {
  assert.deepEqual(page.faults, [], where);
  assert.equal(await page.evaluate(() => window.hacked === undefined && document.querySelector('img[src="x"]') === null), true, `${where}: a name became markup`);
}

export const kHostile = '<img src=x onerror="window.hacked=1">';
