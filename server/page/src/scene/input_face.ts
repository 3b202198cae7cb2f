// Which face of the input a point of the result comes from: read from a mesh file of the job, in the browser.
import { fileUrl, get } from '../api/client';
import type { Artifact } from '../api/types';
import { bytes } from '../base/format';
import type { Vec } from './fit';

export interface NearestFace { inputFace: number; distance_m: number }

const kMaxBytes = 128e6; // about four million faces
const kSizes: Record<string, number> = { char: 1, uchar: 1, short: 2, ushort: 2, int: 4, uint: 4, float: 4, double: 8 };

interface Element { count: number; properties: { name: string; type: string; list: boolean }[] }

// The head of a binary little-endian PLY file: its elements, and where the data begins.
function headOf(file: Uint8Array): { elements: Map<string, Element>; begin: number } {
  const text = new TextDecoder('latin1').decode(file.subarray(0, 8192)), end = text.indexOf('end_header\n');
  if (!text.startsWith('ply\nformat binary_little_endian 1.0\n') || end < 0) throw new Error('The mesh is no binary PLY file.');
  const elements = new Map<string, Element>();
  let last: Element | null = null;
  for (const line of text.slice(0, end).split('\n')) {
    const words = line.split(' ');
    if (words[0] === 'element') {
      last = { count: Number(words[2]), properties: [] };
      elements.set(words[1], last);
    } else if (words[0] === 'property' && last) {
      const list = words[1] === 'list';
      last.properties.push({ name: words[words.length - 1], type: list ? words[3] : words[1], list });
    }
  }
  return { elements, begin: end + 'end_header\n'.length };
}

// Squared distance from the origin to a triangle (Ericson, "Real-Time Collision Detection", 5.1.5).
function squaredDistance(a: Vec, b: Vec, c: Vec): number {
  const dot = (u: Vec, v: Vec) => u[0] * v[0] + u[1] * v[1] + u[2] * v[2];
  const minus = (u: Vec, v: Vec): Vec => [u[0] - v[0], u[1] - v[1], u[2] - v[2]];
  const at = (s: number, t: number) => {
    const p = a.map((x, k) => x + s * ab[k] + t * ac[k]) as Vec;
    return dot(p, p);
  };
  const ab = minus(b, a), ac = minus(c, a), clamp = (x: number) => Math.min(Math.max(x, 0), 1);
  const d1 = -dot(ab, a), d2 = -dot(ac, a), d3 = -dot(ab, b), d4 = -dot(ac, b), d5 = -dot(ab, c), d6 = -dot(ac, c);
  const va = d3 * d6 - d5 * d4, vb = d5 * d2 - d1 * d6, vc = d1 * d4 - d3 * d2;
  if (va > 0 && vb > 0 && vc > 0) return at(vb / (va + vb + vc), vc / (va + vb + vc));
  // On an edge or a corner.
  const s = clamp(d1 / (dot(ab, ab) || 1)), t = clamp(d2 / (dot(ac, ac) || 1)), w = clamp((d4 - d3) / (d4 - d3 + d5 - d6 || 1));
  return Math.min(at(s, 0), at(0, t), at(1 - w, w));
}

// The face of the mesh that is nearest to the point, in the mesh's coordinates. Throws if the file has no triangles
// with `input_face`.
export function nearestFace(file: ArrayBuffer, [x, y, z]: Vec): NearestFace {
  const view = new DataView(file), { elements, begin } = headOf(new Uint8Array(file));
  const vertices = elements.get('vertex'), faces = elements.get('face');
  const offsets = new Map<string, number>();
  let stride = 0;
  for (const { name, type } of vertices?.properties ?? []) {
    offsets.set(name, stride);
    stride += kSizes[type];
  }
  const at = ['x', 'y', 'z'].map((name) => offsets.get(name)), wide = vertices?.properties.find(({ name }) => name === 'x')?.type === 'double';
  let faceStride = 0, inputFace = -1;
  for (const { name, type, list } of faces?.properties ?? []) {
    if (name === 'input_face') inputFace = faceStride;
    faceStride += list ? 1 + 3 * kSizes[type] : kSizes[type];
  }
  if (!vertices || !faces?.properties[0]?.list || at.includes(undefined) || inputFace < 0) throw new Error('The mesh does not say from which input faces it comes.');
  const read = (offset: number) => (wide ? view.getFloat64(offset, true) : view.getFloat32(offset, true));
  const facesBegin = begin + vertices.count * stride;
  const corner = (index: number): Vec => {
    const place = begin + index * stride;
    return [read(place + at[0]!) - x, read(place + at[1]!) - y, read(place + at[2]!) - z];
  };
  let nearest = Infinity, found = -1;
  for (let i = 0; i < faces.count; ++i) {
    const place = facesBegin + i * faceStride;
    if (view.getUint8(place) !== 3) throw new Error('The mesh has other faces than triangles.');
    const squared = squaredDistance(corner(view.getInt32(place + 1, true)), corner(view.getInt32(place + 5, true)), corner(view.getInt32(place + 9, true)));
    if (squared < nearest) [nearest, found] = [squared, view.getInt32(place + inputFace, true)];
  }
  if (found < 0) throw new Error('The mesh has no faces.');
  return { inputFace: found, distance_m: Math.sqrt(nearest) };
}

// The mesh of a job. Files of single tiles do not name input faces, so it is read whole; throws if it is too large.
export async function meshOf(job: string): Promise<Artifact> {
  const list = await get<{ artifacts: Artifact[] }>(`/api/v1/${job}/artifacts?namePrefix=mesh.ply`);
  const mesh = list.artifacts.find(({ name }) => name === 'mesh.ply');
  if (!mesh) throw new Error('the job has no mesh.ply');
  if (Number(mesh.digest.sizeBytes) > kMaxBytes) throw new Error(`only in mesh.ply, which is too large to be read here (${bytes(mesh.digest.sizeBytes)})`);
  return mesh;
}

export async function readMesh(job: string): Promise<ArrayBuffer> {
  const response = await fetch(fileUrl(job, 'mesh.ply'), { credentials: 'same-origin' });
  if (!response.ok) throw new Error(`mesh.ply cannot be read: status ${response.status}`);
  return response.arrayBuffer();
}
