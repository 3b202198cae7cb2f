// The page in a browser, before a mock coordinator.
import assert from 'node:assert/strict';
import { mkdtempSync, rmSync, writeFileSync } from 'node:fs';
import { tmpdir } from 'node:os';
import { join } from 'node:path';
import { after, before, test } from 'node:test';
import { gzipSync } from 'node:zlib';
import { assertSound, builtPage, findings, kHostile, logIn, openPage, picture, sidewaysScroll, startBrowser } from './browser.mjs';
import { makeTiles } from './make_tiles.mjs';
import { MockCoordinator } from './mock_coordinator.mjs';

const kViews = [['jobs', '#/jobs', '.jobs tbody tr'], ['job', '#/jobs/2', 'g.tile'], ['failed_tile', '#/jobs/2?tile=17', '.attempts li'], ['waiting_tile', '#/jobs/2?tile=35', '.panel .link'],
  ['time', '#/jobs/2/timeline', '.strip canvas'], ['energy', '#/jobs/1/energy', 'svg.plot'], ['files', '#/jobs/1/files', 'table.list tbody tr'], ['details', '#/jobs/2/details', '.facts-table'],
  ['partial', '#/jobs/4', '.problems'], ['bad_input', '#/jobs/5', '.problems'], ['no_tiles_yet', '#/jobs/4/result', '.message .button'], ['workers', '#/workers', 'tbody tr'], ['submit', '#/submit', 'fieldset']];

const kDarkViews = ['jobs', 'failed_tile', 'time', 'partial', 'submit', 'workers']; // axe-core in dark colours on a phone, too

let browser, mock, url, folder;

before(async () => {
  folder = mkdtempSync(join(tmpdir(), 'tessera-page-'));
  makeTiles(join(folder, 'export'));
  writeFileSync(join(folder, 'report.json'), JSON.stringify({ frame: { crs: { type: 'utm', zone: 32, north: true }, origin_in_scene: [693_248, 5_330_944, 0], rotation_local_from_scene: [1, 0, 0, 0, 1, 0, 0, 0, 1], up: [0, 0, 1] } }));
  mock = new MockCoordinator(builtPage, join(folder, 'export'));
  url = await mock.listen();
  browser = await startBrowser();
});

after(async () => {
  await browser?.close();
  await mock?.stop();
  rmSync(folder, { recursive: true, force: true });
});

test('a wrong token is refused in words, a right one leads to the address that was asked for', async () => {
  const page = await openPage(browser);
  await page.goto(`${url}#/workers`);
  await page.fill('#token', 'guess');
  await page.keyboard.press('Enter');
  await page.waitForSelector('.fault:has-text("unknown or has expired")');
  assert.deepEqual(await findings(page), []);
  await picture(page, 'login');
  await page.fill('#token', 'viewer-token');
  await page.keyboard.press('Enter');
  await page.waitForSelector('h1:has-text("Workers")');
  assert.equal(await page.evaluate(() => document.cookie), '', 'scripts can read the cookie');
  assert.equal(await page.evaluate(() => JSON.stringify(localStorage) + JSON.stringify(sessionStorage)), '{}{}', 'something is stored');
  await assertSound(page, 'login');
  await page.context().close();
});

test('each role has only its own buttons', async () => {
  const expected = { viewer: [], submitter: ['Pause', 'Priority…', 'Cancel…'], admin: ['Pause', 'Priority…', 'Cancel…'] };
  for (const role of ['viewer', 'submitter', 'admin']) {
    const page = await openPage(browser);
    await logIn(page, url, `${role}-token`);
    assert.equal(await page.locator('nav >> text=Submit').count(), role === 'viewer' ? 0 : 1, role);
    assert.equal(await page.locator('.jobs input[type=checkbox]').count() > 0, role !== 'viewer', role);
    assert.equal(await page.locator('.toolbar button:has-text("Delete")').count(), role === 'admin' ? 1 : 0, role);
    await page.goto(`${url}#/jobs/2`);
    await page.waitForSelector('g.tile');
    assert.deepEqual(await page.locator('.head .buttons button').allTextContents(), expected[role], role);
    await page.goto(`${url}#/jobs/4?tile=17`);
    await page.waitForSelector('.panel');
    assert.equal(await page.locator('text=Retry this tile').count(), role === 'viewer' ? 0 : 1, role);
    await page.goto(`${url}#/jobs/4/result`);
    await page.waitForSelector('.message h2:has-text("no 3D tiles")');
    assert.equal(await page.locator('text=Export 3D tiles').count(), role === 'viewer' ? 0 : 1, role);
    await page.goto(`${url}#/submit`);
    await page.waitForSelector(role === 'viewer' ? 'h1:has-text("Jobs")' : 'h1:has-text("Submit")');
    await assertSound(page, role);
    await page.context().close();
  }
});

test('all views: no serious finding of axe-core, names stay text, nothing wider than the window', async () => {
  for (const [form, options] of [['wide', {}], ['phone', { viewport: { width: 360, height: 740 }, isMobile: true, hasTouch: true, colorScheme: 'dark' }]]) {
    const page = await openPage(browser, options);
    await logIn(page, url, 'admin-token');
    for (const [name, hash, selector] of kViews) {
      await page.goto(url + hash);
      await page.waitForSelector(selector);
      const where = `${form}: ${name}`;
      if (form === 'wide' || kDarkViews.includes(name)) assert.deepEqual(await findings(page), [], where);
      assert.equal(await sidewaysScroll(page), 0, `${where} is wider than the window`);
      await assertSound(page, where);
      await picture(page, `${form}_${name}`);
    }
    await page.goto(`${url}#/jobs/2?tile=17`);
    await page.waitForSelector('.reasons li');
    assert.equal(await page.locator('h1').first().textContent().then((text) => text.includes(kHostile)), true);
    await page.context().close();
  }
});

test('from the list of jobs to the error of a failed tile: one click, its attempts: two', async () => {
  const page = await openPage(browser);
  await logIn(page, url, 'viewer-token');
  await page.click('a.title:has-text("old town")');
  await page.waitForSelector('.problems .reason:has-text("out of memory: 4.1 GiB of 4.0 GiB")');
  await page.click('g.tile[aria-label^="Tile 17,"]');
  await page.waitForSelector('.attempts li.bad .reason:has-text("out of memory")');
  assert.match(await page.textContent('.panel .attempts'), /failed: memory/);
  await page.context().close();
});

test('cameras are asked for when the tiles are known, and once', async (t) => {
  t.after(() => { mock.surveyed = true; });
  const page = await openPage(browser);
  await logIn(page, url, 'viewer-token');
  Object.assign(mock, { surveyed: false, viewsAsked: 0 });
  await page.goto(`${url}#/jobs/2?tile=9`);
  await page.waitForSelector('text=The tiles are planned when the scene has been read.');
  mock.change('jobs/2', { stage: 'reading the scene' });
  await page.waitForSelector('.stage:has-text("reading the scene")');
  assert.equal(mock.viewsAsked, 0);
  mock.surveyed = true;
  for (const [i, step] of ['solving step 11 of 26', 'solving step 12 of 26'].entries()) {
    mock.change('jobs/2', { stage: step });
    await page.waitForSelector(`.stage:has-text("${step}")`);
    if (i === 0) await page.waitForSelector('.cameras circle');
  }
  assert.equal(mock.viewsAsked, 1);
  await page.context().close();
});

test('by keyboard alone: a tile is chosen, and the layer is changed', async () => {
  const page = await openPage(browser);
  await logIn(page, url, 'viewer-token');
  await page.goto(`${url}#/jobs/2`);
  await page.waitForSelector('g.tile');
  await page.focus('g.tile[tabindex="0"]');
  for (const key of ['ArrowRight', 'ArrowUp', 'Enter']) await page.keyboard.press(key);
  await page.waitForSelector('.panel h2:has-text("Tile 9")');
  assert.match(page.url(), /tile=9/);
  assert.equal(await page.evaluate(() => document.activeElement.getAttribute('aria-label')), 'Tile 9, done');
  await page.selectOption('.map select', 'memory');
  await page.waitForSelector('.legend .ramp');
  assert.match(await page.getAttribute('g.tile.selected', 'aria-label'), /memory 1\.\d/);
  await page.context().close();
});

test('several jobs at once: asked first, and only those that allow it are changed', async () => {
  const page = await openPage(browser);
  await logIn(page, url, 'admin-token');
  for (const name of ['harbour', 'airport', 'river bank']) await page.check(`[aria-label="Select ${name}"]`);
  mock.calls.length = 0;
  await page.click('.toolbar button:has-text("Cancel")');
  await page.waitForSelector('dialog:has-text("Cancel: 2 jobs")');
  assert.deepEqual(await findings(page), []);
  await picture(page, 'dialog');
  await page.click('dialog button:has-text("Back")');
  assert.deepEqual(mock.calls, []);
  await page.click('.toolbar button:has-text("Priority")');
  await page.fill('#dialog-number', '12');
  await page.keyboard.press('Enter');
  await page.waitForSelector('.notice:has-text("2 jobs changed")');
  assert.deepEqual(mock.calls.map(({ method, path, body }) => [method, path, body]).sort(), [['PATCH', '/api/v1/jobs/3', { priority: 12 }], ['PATCH', '/api/v1/jobs/6', { priority: 12 }]]);
  await page.selectOption('#filter-state', 'failed');
  await page.waitForFunction(() => document.querySelectorAll('.jobs tbody tr').length === 1);
  assert.match(page.url(), /state=failed/);
  await page.context().close();
});

test('a job is quoted before it starts', async () => {
  const page = await openPage(browser);
  await logIn(page, url, 'submitter-token');
  await page.click('nav >> text=Submit');
  await page.fill('#scene', '/etc');
  await page.click('button:has-text("Get a quote")');
  await page.waitForSelector('.note.bad:has-text("not below a scene root")');
  await page.fill('#scene', '/srv/cities/new');
  await page.fill('#title', 'new city');
  mock.calls.length = 0;
  await page.click('button:has-text("Get a quote")');
  await page.waitForSelector('text=Nothing has started yet');
  await picture(page, 'quote');
  assert.deepEqual(mock.calls.map(({ path }) => path), ['/api/v1/quote']);
  await page.fill('#setting-rounds', '4');
  await page.fill('#setting-tile_memory', '2'); // GiB
  await page.keyboard.press('Tab');
  await page.waitForSelector('button:has-text("Get a quote")'); // the quote is void
  await page.click('button:has-text("Get a quote")');
  await page.click('button:has-text("Start the job")');
  await page.waitForSelector('h1:has-text("new city")');
  assert.equal(mock.calls.at(-1).body.settings.rounds, 4);
  assert.equal(mock.calls.at(-1).body.settings.tileMemoryBytes, 2 ** 31);
  assert.match(mock.calls.at(-1).body.requestId, /^[0-9a-f]{32}$/);
  await assertSound(page, 'submit');
  await page.context().close();
});

test('live: by the stream, by polls when there is no stream, and again after a restart', async () => {
  const page = await openPage(browser);
  await logIn(page, url, 'viewer-token');
  await page.goto(`${url}#/jobs/2`);
  const shows = (text) => page.waitForFunction((wanted) => document.querySelector('.main-progress')?.textContent.includes(wanted), text, { polling: 20 });
  await shows('step 12');
  await page.waitForFunction(() => true);
  while (mock.streams.size === 0) await new Promise((resolve) => setTimeout(resolve, 20));
  let start = Date.now();
  mock.change('jobs/2', { stage: 'solving step 13 of 26' });
  await shows('step 13');
  console.log(`stream: ${Date.now() - start} ms`);
  assert.ok(Date.now() - start < 1000, 'the stream is slow');
  const { port } = mock;
  await mock.stop();
  await page.waitForSelector('.away:has-text("has not answered since")');
  await picture(page, 'away');
  assert.deepEqual(await findings(page), []);
  mock.streamsAllowed = false;
  Object.assign(mock, { server: new MockCoordinator(builtPage, null).server });
  const again = new MockCoordinator(builtPage, join(folder, 'export'));
  again.streamsAllowed = false;
  again.change('jobs/2', { stage: 'solving step 14 of 26' });
  await again.listen(port);
  mock = again;
  await shows('step 14'); // also the session, which the restart has lost, is new
  await page.waitForSelector('.away', { state: 'hidden' });
  start = Date.now();
  mock.change('jobs/2', { stage: 'solving step 15 of 26' });
  await shows('step 15');
  console.log(`poll: ${Date.now() - start} ms`);
  assert.ok(Date.now() - start < 3500, 'the poll is slow');
  await assertSound(page, 'live');
  await page.context().close();
});

async function openResult(page, query = '') {
  await page.goto(`${url}#/jobs/1/result${query}`);
  await page.waitForSelector('.result[data-loading="false"]');
}

test('3D: start and result, classes, colours, a point, a distance, the address', async () => {
  const page = await openPage(browser);
  await logIn(page, url, 'viewer-token');
  const begin = Date.now();
  await openResult(page);
  console.log(`first picture: ${Date.now() - begin} ms`);
  const box = await page.locator('.holder canvas').boundingBox();
  const look = async (name) => {
    await page.waitForTimeout(250);
    return (await picture(page, `3d_${name}`, { clip: box })).toString('base64');
  };
  await picture(page, '3d');
  assert.deepEqual(await findings(page), []);
  const both = await look('both');
  await page.fill('.wipe input', '0');
  const result = await look('result');
  await page.fill('.wipe input', '100');
  const start = await look('start');
  assert.ok(both !== result && result !== start && both !== start, 'the slider changes nothing');
  await page.fill('.wipe input', '0');
  await page.uncheck('.choices label:has-text("roof") input');
  assert.notEqual(await look('without_roofs'), result);
  await page.check('.choices label:has-text("roof") input');
  for (const mode of ['Confidence', 'Displacement']) {
    await page.check(`.choices label:has-text("${mode}") input`);
    assert.notEqual(await look(mode.toLowerCase()), result);
  }
  await page.mouse.click(box.x + 0.5 * box.width, box.y + 0.62 * box.height);
  await page.waitForSelector('[data-key="hit"] dt:has-text("WGS 84")');
  const facts = await page.textContent('[data-key="hit"]');
  assert.match(facts, /Surfaceresult/);
  assert.match(facts, /Class(ground|roof|facade)/);
  assert.match(facts, /Confidence\d+/);
  assert.match(facts, /Tiletile \d+/);
  assert.match(facts, /LV95 \(EPSG:2056\).*2600\d{3}\.\d\d, 1200\d{3}\.\d\d/);
  assert.match(facts, /WGS 8446\.\d+°, 7\.\d+°/);
  await page.click('button:has-text("Measure")');
  for (const x of [0.45, 0.55]) await page.mouse.click(box.x + x * box.width, box.y + 0.62 * box.height);
  await page.waitForSelector('[data-key="measure"] b');
  assert.ok(parseFloat(await page.textContent('[data-key="measure"] b')) > 5);
  await page.selectOption('#camera-tile', '19');
  await page.waitForSelector('text=3 cameras are drawn');
  await picture(page, '3d_cameras');
  await page.waitForFunction(() => location.hash.includes('camera='));
  const address = page.url();
  await page.goto('about:blank');
  await page.goto(address);
  await page.fill('#token', 'viewer-token').catch(() => {});
  await page.waitForSelector('.result[data-loading="false"]');
  await page.waitForSelector('text=3 cameras are drawn');
  assert.equal(page.url().replace(/.*camera=([^&]*).*/, '$1'), address.replace(/.*camera=([^&]*).*/, '$1'));
  const names = await page.evaluate(() => performance.getEntriesByType('resource').map(({ name }) => name).filter((name) => name.endsWith('.js')));
  let compressed = 0;
  for (const name of names) compressed += gzipSync(Buffer.from(await (await fetch(name)).arrayBuffer()), { level: 9 }).length;
  console.log(`scripts before the first picture: ${compressed} bytes compressed, ${names.length} files`);
  assert.ok(names.length >= 2 && compressed <= 250_000, 'bar: 250 kB');
  await assertSound(page, '3d');
  await page.context().close();
});

test('a result without 3D tiles is exported by a button, and then shown', async () => {
  const page = await openPage(browser);
  await logIn(page, url, 'submitter-token');
  await page.goto(`${url}#/jobs/4/result`);
  await page.click('button:has-text("Export 3D tiles")');
  await page.waitForSelector('h2:has-text("are being written")');
  assert.deepEqual(mock.calls.at(-1).body.export, { formats: ['3dtiles'] });
  mock.change('jobs/50', { state: 'JOB_STATE_FAILED', error: `disk full ${kHostile}` });
  await page.waitForSelector('.message:has-text("disk full")');
  await assertSound(page, 'export');
  await page.context().close();
});

test('without WebGL: pictures of the report, and why', async () => {
  const without = await startBrowser(false);
  const page = await openPage(without);
  await logIn(page, url, 'viewer-token');
  await page.goto(`${url}#/jobs/1/result`);
  await page.waitForSelector('.note:has-text("No 3D view")');
  assert.match(await page.textContent('.note'), /WebGL 2/);
  assert.equal(await page.locator('.pictures img').count(), 2);
  assert.deepEqual(await findings(page), []);
  await picture(page, 'without_webgl');
  await assertSound(page, 'without WebGL');
  await without.close();
});
