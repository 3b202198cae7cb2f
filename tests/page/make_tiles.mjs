// Writes a small city as 3D Tiles, with the attributes and the table of classes that `tessera export --to 3dtiles` writes.
import { mkdirSync, writeFileSync } from 'node:fs';
import { join } from 'node:path';

const kClasses = [['ground', [150, 140, 120], 2], ['roof', [200, 70, 60], 6], ['facade', [225, 205, 160], 6], ['unlabelled', [160, 160, 160], 0]];

// Boxes on a plane: corners (east, north, up), a class per face.
function cityFaces(x0, y0, size, blocks, lift) {
  const faces = [];
  const quad = (a, b, c, d, label) => faces.push([[a, b, c], label], [[a, c, d], label]);
  quad([x0, y0, 0], [x0 + size, y0, 0], [x0 + size, y0 + size, 0], [x0, y0 + size, 0], 0);
  const step = size / blocks;
  for (let i = 0; i < blocks; ++i) {
    for (let j = 0; j < blocks; ++j) {
      const a = x0 + (i + 0.2) * step, b = a + 0.6 * step, c = y0 + (j + 0.2) * step, d = c + 0.6 * step, h = lift * (8 + ((7 * i + 5 * j + x0) % 9));
      quad([a, c, h], [b, c, h], [b, d, h], [a, d, h], 1);
      quad([a, c, 0], [b, c, 0], [b, c, h], [a, c, h], 2);
      quad([b, c, 0], [b, d, 0], [b, d, h], [b, c, h], 2);
      quad([b, d, 0], [a, d, 0], [a, d, h], [b, d, h], 2);
      quad([a, d, 0], [a, c, 0], [a, c, h], [a, d, h], 2);
    }
  }
  return faces;
}

// `measured`: with confidence and displacement, as a result has them.
function glb(faces, measured) {
  const buffers = [], views = [], accessors = [];
  let length = 0;
  const view = (array) => {
    const bytes = Buffer.from(array.buffer, array.byteOffset, array.byteLength), pad = Buffer.alloc((8 - (bytes.length % 8)) % 8);
    views.push({ buffer: 0, byteOffset: length, byteLength: bytes.length });
    buffers.push(bytes, pad);
    length += bytes.length + pad.length;
    return views.length - 1;
  };
  const accessor = (array, componentType, type, count, more = {}) => accessors.push({ bufferView: view(array), componentType, type, count, ...more }) - 1;
  const count = 3 * faces.length, positions = new Float32Array(3 * count), normals = new Float32Array(3 * count), colors = new Uint16Array(4 * count);
  const features = new Uint16Array(2 * count), confidence = new Float32Array(count), displacement = new Float32Array(count);
  faces.forEach(([corners, label], f) => {
    const [a, b, c] = corners.map(([e, n, u]) => [e, u, -n]);
    const u = b.map((x, k) => x - a[k]), v = c.map((x, k) => x - a[k]);
    const n = [u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]], size = Math.hypot(...n);
    [a, b, c].forEach((p, k) => {
      const i = 3 * f + k;
      positions.set(p, 3 * i);
      normals.set(n.map((x) => x / size), 3 * i);
      colors.set([...kClasses[label][1].map((x) => 257 * x), 65535], 4 * i);
      features[2 * i] = label;
      confidence[i] = 0.5 + 0.5 * Math.abs(Math.sin(p[0] / 30));
      displacement[i] = 0.5 * Math.abs(Math.cos(p[2] / 40));
    });
  });
  const min = [Infinity, Infinity, Infinity], max = [-Infinity, -Infinity, -Infinity];
  for (let i = 0; i < positions.length; ++i) [min[i % 3], max[i % 3]] = [Math.min(min[i % 3], positions[i]), Math.max(max[i % 3], positions[i])];
  const attributes = {
    POSITION: accessor(positions, 5126, 'VEC3', count, { min, max }), NORMAL: accessor(normals, 5126, 'VEC3', count),
    COLOR_0: accessor(colors, 5123, 'VEC4', count, { normalized: true }), _FEATURE_ID_0: accessor(features, 5123, 'SCALAR', count),
    ...(measured && { _CONFIDENCE: accessor(confidence, 5126, 'SCALAR', count), _DISPLACEMENT: accessor(displacement, 5126, 'SCALAR', count) }),
  };
  views[accessors[attributes._FEATURE_ID_0].bufferView].byteStride = 4;
  const indices = accessor(Uint32Array.from({ length: count }, (_, i) => i), 5125, 'SCALAR', count);
  const names = kClasses.map(([name]) => name).join(''), ends = new Uint32Array(kClasses.length + 1);
  kClasses.forEach(([name], i) => { ends[i + 1] = ends[i] + name.length; });
  const properties = {
    name: { values: view(Buffer.from(names)), stringOffsets: view(ends) }, color: { values: view(Uint8Array.from(kClasses.flatMap((c) => c[1]))) },
    asprs: { values: view(Uint8Array.from(kClasses.map((c) => c[2]))) },
  };
  const json = {
    asset: { version: '2.0' }, extensionsUsed: ['EXT_mesh_features', 'EXT_structural_metadata'], scene: 0, scenes: [{ nodes: [0] }], nodes: [{ mesh: 0 }],
    meshes: [{ primitives: [{ attributes, indices, material: 0, extensions: { EXT_mesh_features: { featureIds: [{ featureCount: kClasses.length, attribute: 0, propertyTable: 0 }] } } }] }],
    materials: [{ pbrMetallicRoughness: { metallicFactor: 0 }, doubleSided: true }], accessors, bufferViews: views, buffers: [{ byteLength: length }],
    extensions: { EXT_structural_metadata: {
      schema: { id: 'tessera', classes: { surface: { properties: { name: { type: 'STRING', required: true }, color: { type: 'VEC3', componentType: 'UINT8', required: true }, asprs: { type: 'SCALAR', componentType: 'UINT8', required: true } } } } },
      propertyTables: [{ class: 'surface', name: 'classes', count: kClasses.length, properties }],
    } },
  };
  let text = Buffer.from(JSON.stringify(json));
  text = Buffer.concat([text, Buffer.alloc((4 - (text.length % 4)) % 4, 32)]);
  const binary = Buffer.concat(buffers), head = Buffer.alloc(20), middle = Buffer.alloc(8);
  head.writeUInt32LE(0x46546c67, 0);
  head.writeUInt32LE(2, 4);
  head.writeUInt32LE(28 + text.length + binary.length, 8);
  head.writeUInt32LE(text.length, 12);
  head.writeUInt32LE(0x4e4f534a, 16);
  middle.writeUInt32LE(binary.length, 0);
  middle.writeUInt32LE(0x004e4942, 4);
  return Buffer.concat([head, text, middle, binary]);
}

// Geodetic to the transform of a tile set there.
function transformAt(lat_deg, lon_deg) {
  const lat = (lat_deg * Math.PI) / 180, lon = (lon_deg * Math.PI) / 180, a = 6378137, e2 = 0.0066943799901413165, n = a / Math.sqrt(1 - e2 * Math.sin(lat) ** 2);
  return [-Math.sin(lon), Math.cos(lon), 0, 0, -Math.sin(lat) * Math.cos(lon), -Math.sin(lat) * Math.sin(lon), Math.cos(lat), 0, Math.cos(lat) * Math.cos(lon), Math.cos(lat) * Math.sin(lon), Math.sin(lat), 0,
    n * Math.cos(lat) * Math.cos(lon), n * Math.cos(lat) * Math.sin(lon), n * (1 - e2) * Math.sin(lat), 1];
}

// Writes FOLDER/3dtiles/{start,result}, over 800 x 500 m, as the tiles of the mock coordinator's jobs.
export function makeTiles(folder) {
  for (const [set, lift] of [['result', 1.6], ['start', 1]]) {
    const out = join(folder, '3dtiles', set);
    mkdirSync(out, { recursive: true });
    const box = (x, y, sx, sy) => ({ box: [x + sx / 2, y + sy / 2, 15, sx / 2, 0, 0, 0, sy / 2, 0, 0, 0, 16] });
    const children = [];
    for (let x = 0; x < 800; x += 200) {
      for (let y = 0; y < 500; y += 250) {
        writeFileSync(join(out, `${x}_${y}.glb`), glb(cityFaces(x, y, 200, 5, lift), set === 'result'));
        children.push({ boundingVolume: box(x, y, 200, 250), geometricError: 0, content: { uri: `${x}_${y}.glb` } });
      }
    }
    writeFileSync(join(out, 'root.glb'), glb(cityFaces(0, 0, 500, 4, lift), set === 'result'));
    writeFileSync(join(out, 'tileset.json'), JSON.stringify({ asset: { version: '1.1' }, geometricError: 900,
      root: { boundingVolume: box(0, 0, 800, 500), geometricError: 60, refine: 'REPLACE', content: { uri: 'root.glb' }, transform: transformAt(48.1, 11.6), children } }));
  }
}
