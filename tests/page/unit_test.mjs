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

test('a camera sees a whole box, and no camera that is nearer does', async () => {
  const { fitCorners } = await load('scene/fit');
  const tans = [0.8, 0.45];
  for (let k = 0; k < 200; ++k) {
    // A box of any size, turned about the axis across the view, as a city is seen from the air.
    const [a, b, c, tilt] = [50 + 7 * k, 20 + 13 * (k % 29), 5 + (k % 11), 0.1 * (k % 15)];
    const corners = [0, 1, 2, 3, 4, 5, 6, 7].map((i) => {
      const [x, y, z] = [i & 1 ? a : -a, i & 2 ? b : -b, i & 4 ? c : 0];
      return [x + 500, y * Math.cos(tilt) - z * Math.sin(tilt) - 80, y * Math.sin(tilt) + z * Math.cos(tilt)];
    });
    const at = fitCorners(corners, ...tans);
    // How far out a corner is, as a share of half of the view: 1 is the border.
    const seen = (from) => corners.map(([x, y, z]) => Math.max(Math.abs(x - from.x) / (tans[0] * (from.distance - z)), Math.abs(y - from.y) / (tans[1] * (from.distance - z))));
    assert.ok(corners.every(([, , z]) => z < at.distance), 'a corner is behind the camera');
    near(Math.max(...seen(at)), 1, 1e-9);
    for (const [dx, dy] of [[0, 0], [1, 0], [-1, 0], [0, 1], [0, -1]]) {
      assert.ok(Math.max(...seen({ x: at.x + dx, y: at.y + dy, distance: at.distance - 0.5 })) > 1, 'a nearer camera sees it, too');
    }
  }
});

test('the input face of a point is that of the nearest face of mesh.ply', async () => {
  const { nearestFace } = await load('scene/input_face');
  const points = [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 5], [1, 0, 5], [0, 1, 5]], faces = [[0, 1, 2, 700], [3, 4, 5, 900]];
  const head = 'ply\nformat binary_little_endian 1.0\nelement vertex 6\nproperty double x\nproperty double y\nproperty double z\nelement face 2\n'
    + 'property list uchar int vertex_indices\nproperty int label\nproperty uchar red\nproperty uchar green\nproperty uchar blue\nproperty float confidence\nproperty int input_face\nend_header\n';
  const ply = Buffer.alloc(head.length + 6 * 24 + 2 * 28);
  ply.write(head, 'latin1');
  points.forEach((p, i) => p.forEach((x, k) => ply.writeDoubleLE(5e6 + x, head.length + 24 * i + 8 * k)));
  faces.forEach(([a, b, c, from], i) => {
    const at = head.length + 6 * 24 + 28 * i;
    ply.writeUInt8(3, at);
    [a, b, c].forEach((v, k) => ply.writeInt32LE(v, at + 1 + 4 * k));
    ply.writeInt32LE(from, at + 24);
  });
  const file = ply.buffer.slice(ply.byteOffset, ply.byteOffset + ply.length);
  for (const [point, face, distance] of [[[0.2, 0.2, 0.5], 700, 0.5], [[0.2, 0.2, 4.9], 900, 0.1], [[3, 0, 0], 700, 2], [[-3, -4, 0], 700, 5], [[1, 1, 0], 700, Math.SQRT1_2], [[0.2, -2, 0], 700, 2]]) {
    const found = nearestFace(file, point.map((x) => 5e6 + x));
    assert.equal(found.inputFace, face);
    near(found.distance_m, distance, 1e-6);
  }
  const without = Buffer.from(ply.toString('latin1').replace('int input_face', 'int other_value'), 'latin1');
  assert.throws(() => nearestFace(without.buffer.slice(without.byteOffset, without.byteOffset + without.length), [0, 0, 0]), /input faces/);
  assert.throws(() => nearestFace(new ArrayBuffer(10), [0, 0, 0]), /PLY/);
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
