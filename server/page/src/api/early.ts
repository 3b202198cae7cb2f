// Files that a view needs first, asked for before the view exists: beside its scripts and the log-in.
import { fileUrl } from './client';

export interface Tileset { root?: { transform?: number[]; content?: { uri?: string } } }

const kKept_ms = 60_000; // a file that nobody takes
const files = new Map<string, Promise<Response>>();

function request(url: string): Promise<Response> {
  let file = files.get(url);
  if (!file) {
    file = fetch(url, { credentials: 'same-origin' });
    files.set(url, file);
    file.then(({ ok }) => setTimeout(() => files.delete(url), ok ? kKept_ms : 0), () => files.delete(url));
  }
  return file;
}

// Asks for a tile set of `job` and for the content of its root.
export function requestTileset(job: string, name: string): void {
  const url = fileUrl(job, name);
  void request(url).then(async (response) => {
    const uri = response.ok ? (await response.clone().json() as Tileset).root?.content?.uri : undefined;
    if (uri && !uri.endsWith('.json')) void request(new URL(uri, new URL(url, location.href)).pathname);
  }).catch(() => {}); // whoever needs the file asks again
}

// The answer if the file was asked for and is there, else null. An answer is given once.
export async function takeFile(url: string): Promise<Response | null> {
  const path = new URL(url, location.href).pathname, file = files.get(path);
  files.delete(path);
  try {
    const response = file && await file;
    return response?.ok ? response : null;
  } catch {
    return null;
  }
}

// The parsed tile set; null: there is none. takeFile gives its answer, too.
export async function readTileset(url: string): Promise<Tileset | null> {
  const file = files.get(url);
  const response = file && await file.catch(() => null);
  if (response?.ok) return await response.clone().json() as Tileset;
  files.delete(url);
  return null;
}
