// Functions of the page that need no browser. They are bundled with the esbuild that built the page.
import assert from 'node:assert/strict';
import { mkdtempSync, rmSync } from 'node:fs';
import { createRequire } from 'node:module';
import { tmpdir } from 'node:os';
import { join, resolve } from 'node:path';
import { after, test } from 'node:test';
import { pathToFileURL } from 'node:url';

const work = resolve(`${process.env.TESSERA_PAGE}.work`), folder = mkdtempSync(join(tmpdir(), 'tessera-page-'));
const esbuild = createRequire(join(work, 'package.json'))('esbuild');

async function load(module) {
  const outfile = join(folder, `${module.replaceAll('/', '_')}.mjs`);
  await esbuild.build({ entryPoints: [join(work, 'src', `${module}.ts`)], bundle: true, format: 'esm', outfile, logLevel: 'error' });
  return import(pathToFileURL(outfile).href);
}

after(() => rmSync(folder, { recursive: true, force: true }));

const near = (found, expected, tolerance) => assert.ok(Math.abs(found - expected) <= tolerance, `${found} is not ${expected}`);

// Of GeographicLib: latitude, longitude, height, zone, north; easting, northing; ECEF.
const kPoints = [
  [48.1, 11.6, 500, 32, true, 693566.08829, 5330684.896675, 4180613.72362, 858156.754168, 4724681.421027],
  [-33.9, 18.4, 20, 34, false, 259583.22166, 6245888.045441, 5028539.537982, 1672772.462298, -3537256.502807],
  [60.17, 24.94, 0, 35, true, 385700.421386, 6672126.743134, 2884088.15657, 1341197.254407, 5509922.952983],
  [69.9, 20.1, 3, 34, true, 465482.390408, 7754976.054282, 2064512.961599, 755504.457906, 5967218.053585],
  [48.3, 5.7, 10, 31, true, 700228.940823, 5353168.565439, 4229858.168412, 422195.97319, 4739139.634446]];

test('coordinates agree with GeographicLib within a tenth of a millimetre', async () => {
  const { ecefFromGeodetic, geodeticFromEcef, geodeticFromUtm, utmFromGeodetic } = await load('scene/geodesy');
  for (const [lat_deg, lon_deg, height_m, zone, north, easting, northing, ...ecef] of kPoints) {
    const place = { lat_deg, lon_deg, height_m };
    const utm = utmFromGeodetic(place, zone, north);
    near(utm[0], easting, 1e-4);
    near(utm[1], northing, 1e-4);
    ecefFromGeodetic(place).forEach((x, k) => near(x, ecef[k], 1e-4));
    for (const back of [geodeticFromEcef(ecef), geodeticFromUtm([easting, northing, height_m], zone, north)]) {
      near(back.lat_deg, lat_deg, 1e-9);
      near(back.lon_deg, lon_deg, 1e-9);
      near(back.height_m, height_m, 1e-4);
    }
  }
});

test('a scene has its coordinates, its ground and its way back in every system', async () => {
  const { ecefFromGeodetic, SceneFrame } = await load('scene/geodesy');
  const identity = [1, 0, 0, 0, 1, 0, 0, 0, 1], at = { lat_deg: 48.1, lon_deg: 11.6, height_m: 0 };
  const lat = (48.1 * Math.PI) / 180, lon = (11.6 * Math.PI) / 180;
  const globe = [-Math.sin(lon), Math.cos(lon), 0, 0, -Math.sin(lat) * Math.cos(lon), -Math.sin(lat) * Math.sin(lon), Math.cos(lat), 0,
    Math.cos(lat) * Math.cos(lon), Math.cos(lat) * Math.sin(lon), Math.sin(lat), 0, ...ecefFromGeodetic(at), 1];
  const frames = [
    [null, { crs: { type: 'local' }, origin_in_scene: [1, 2, 3], rotation_local_from_scene: identity, up: [0, 0.6, 0.8] }],
    [globe, { crs: { type: 'enu', ...at }, origin_in_scene: [0, 0, 0], rotation_local_from_scene: identity, up: [0, 0, 1] }],
    [globe, { crs: { type: 'utm', zone: 32, north: true }, origin_in_scene: [693248, 5330944, 0], rotation_local_from_scene: identity, up: [0, 0, 1] }],
    [globe, { crs: { type: 'projected', epsg: 25832, geoid_height_m: 45 }, origin_in_scene: [693248, 5330944, 0], rotation_local_from_scene: identity, up: [0, 0, 1] }],
    [globe, { crs: { type: 'ecef' }, origin_in_scene: ecefFromGeodetic(at), rotation_local_from_scene: [globe[0], globe[1], globe[2], globe[4], globe[5], globe[6], globe[8], globe[9], globe[10]], up: [0, 0, 1] }]];
  for (const [transform, frame] of frames) {
    const map = new SceneFrame(transform, frame), enu = [120, -80, 33];
    map.enu(map.scene(enu).p).forEach((x, k) => near(x, enu[k], 1e-4));
    assert.equal(map.onGround(enu).length, 2);
  }
  const utm = new SceneFrame(globe, frames[2][1]);
  near(utm.onGround([0, 0, 0])[0], 693566.0883 - 693248, 0.01);
  near(new SceneFrame(globe, frames[3][1]).scene([0, 0, 0]).p[2], -45, 1e-4);
  assert.equal(new SceneFrame(globe, { ...frames[3][1], crs: { type: 'projected', epsg: 2056 } }).scene([0, 0, 0]), null);
  assert.equal(new SceneFrame(globe, null).scene([0, 0, 0]), null);
});

test('figures as text', async () => {
  const { bytes, coreTime, duration, durationRange, percent } = await load('base/format');
  const plain = (text) => text.replaceAll('\u00a0', ' ').replaceAll('\u2011', '-');
  assert.equal(plain(duration(59.6)), '1 min');
  assert.equal(plain(duration(3600 * 3 + 300)), '3 h 5 min');
  assert.equal(plain(durationRange(720, 1080)), '12 to 18 min');
  assert.equal(plain(durationRange(50, 50)), '50 s');
  assert.equal(plain(bytes(String(3 * 2 ** 30))), '3.0 GiB');
  assert.equal(plain(coreTime(5400)), '1.5 core-h');
  assert.equal(plain(percent(0.999)), '99 %'); // never 100 % before the end
});

test('attempts of a worker that overlap have rows of their own', async () => {
  const { rowsOf } = await load('job/timeline');
  const at = (s) => new Date(1e12 + 1000 * s).toISOString();
  const attempt = (worker, from, to) => ({ worker, machine: 'm', startTime: at(from), endTime: to === null ? undefined : at(to) });
  const rows = rowsOf({ createTime: at(0) }, [attempt('workers/2', 0, 10), attempt('workers/10', 5, null), attempt('workers/2', 9, 12), attempt('workers/2', 12, 15)], 1e12 + 20_000);
  assert.deepEqual(rows.map(({ worker, slices }) => [worker, slices.length]), [['workers/2', 2], ['workers/2', 1], ['workers/10', 1]]);
  assert.equal(rows[2].slices[0].end_s, 20); // it still runs
});
