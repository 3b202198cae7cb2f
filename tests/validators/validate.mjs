// Reads all files of an export by programs that are not ours, and reports what they find. Usage: node validate.mjs FOLDER
// GLB: gltf-validator, without errors and warnings. GeoTIFF: geotiff.js reads all pixels. 3D Tiles: every tile set
// satisfies the schema (ajv) and is walked from its root. Exit code 1 if a file is wrong, 2 if the folder has none that is read here.
import fs from 'node:fs';
import path from 'node:path';
import Ajv from 'ajv/dist/2020.js';
import {fromArrayBuffer} from 'geotiff';
import validator from 'gltf-validator';

const [folder] = process.argv.slice(2);
const schema = JSON.parse(fs.readFileSync(new URL('tileset.schema.json', import.meta.url), 'utf8'));
const isTileset = new Ajv({allErrors: true, strict: false}).compile(schema);
const faults = [];
const counts = {glb: 0, tif: 0, tiles: 0};

function bytesOf(file) {
  return new Uint8Array(fs.readFileSync(file));
}

async function checkGlb(file) {
  counts.glb++;
  const report = await validator.validateBytes(bytesOf(file), {uri: path.basename(file), maxIssues: 20});
  for (const issue of report.issues.messages) {
    if (issue.severity <= 1) faults.push(`${file}: ${issue.code} at ${issue.pointer ?? issue.offset}: ${issue.message}`);
  }
}

async function checkTiff(file) {
  counts.tif++;
  const bytes = bytesOf(file);
  const tiff = await fromArrayBuffer(bytes.buffer.slice(bytes.byteOffset, bytes.byteOffset + bytes.byteLength));
  for (let level = 0; level < await tiff.getImageCount(); ++level) {
    const image = await tiff.getImage(level);
    const rasters = await image.readRasters();
    if (rasters[0].length !== image.getWidth() * image.getHeight()) faults.push(`${file}: level ${level} is cut`);
  }
  const image = await tiff.getImage(0);
  if (image.getBoundingBox().some((value) => !Number.isFinite(value))) faults.push(`${file}: has no place`);
}

// Walks a tile and what it refers to; `error` is the geometric error of its parent.
function checkTile(tile, file, error, seen) {
  counts.tiles++;
  if (tile.geometricError > error) {
    faults.push(`${file}: found geometricError ${tile.geometricError}, expected at most that of the parent, ${error}`);
  }
  if (tile.content) {
    const target = path.join(path.dirname(file), decodeURIComponent(tile.content.uri));
    if (!fs.existsSync(target)) {
      faults.push(`${file}: found content ${tile.content.uri}, which does not exist`);
    } else if (target.endsWith('.json')) {
      checkTileset(target, tile.geometricError, seen);
    }
  }
  for (const child of tile.children ?? []) checkTile(child, file, tile.geometricError, seen);
}

function checkTileset(file, error, seen) {
  if (seen.has(file)) return;
  seen.add(file);
  const tileset = JSON.parse(fs.readFileSync(file, 'utf8'));
  if (!isTileset(tileset)) {
    for (const fault of isTileset.errors) faults.push(`${file}: ${fault.instancePath}: ${fault.message}`);
    return;
  }
  checkTile(tileset.root, file, Math.min(error, tileset.geometricError), seen);
}

const files = fs.readdirSync(folder, {recursive: true}).map((name) => path.join(folder, name)).sort();
const seen = new Set();
for (const file of files) {
  if (file.endsWith('.glb')) await checkGlb(file);
  if (file.endsWith('.tif')) await checkTiff(file);
  if (path.basename(file) === 'tileset.json' && path.basename(path.dirname(file)).match(/^(result|start)$/)) {
    checkTileset(file, Infinity, seen);
  }
}
for (const fault of faults) console.log(fault);
console.log(`read ${counts.glb} GLB, ${counts.tif} GeoTIFF, ${counts.tiles} tiles: ${faults.length} faults`);
process.exitCode = faults.length > 0 ? 1 : counts.glb + counts.tif + counts.tiles === 0 ? 2 : 0;
