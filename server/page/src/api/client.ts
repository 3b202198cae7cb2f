// Calls of the HTTP API.
import { reportAnswer, reportSilence } from './connection';

export class ApiError extends Error {
  constructor(readonly status: number, readonly code: string, message: string) {
    super(message);
  }
  // The coordinator cannot be reached, or cannot serve now: try again later.
  get away(): boolean {
    return this.status === 0 || this.code === 'UNAVAILABLE' || this.status === 502 || this.status === 504;
  }
}

export interface Answer<T> { value: T | null; etag: string } // null: not modified

type Reauthenticate = () => Promise<boolean>;
let reauthenticate: Reauthenticate = async () => false;

// `again`: called when a call is refused without a valid session. It answers whether there is one now.
export function setReauthenticate(again: Reauthenticate): void {
  reauthenticate = again;
}

async function send(method: string, path: string, body: unknown, etag: string): Promise<Response> {
  const headers: Record<string, string> = {};
  if (method !== 'GET') headers['X-Tessera'] = '1';
  if (body !== undefined) headers['Content-Type'] = 'application/json';
  if (etag) headers['If-None-Match'] = etag;
  const limit = new AbortController();
  const timer = setTimeout(() => limit.abort(), method === 'GET' ? 20_000 : 120_000);
  try {
    return await fetch(path, {
      method, headers, credentials: 'same-origin', cache: 'no-store', signal: limit.signal,
      body: body === undefined ? undefined : JSON.stringify(body),
    });
  } catch {
    reportSilence();
    throw new ApiError(0, 'UNAVAILABLE', 'The coordinator does not answer.');
  } finally {
    clearTimeout(timer);
  }
}

async function errorOf(response: Response): Promise<ApiError> {
  let code = '', message = `The coordinator answered with status ${response.status}.`;
  try {
    const body = await response.json();
    if (typeof body.code === 'string') code = body.code;
    if (typeof body.message === 'string' && body.message) message = body.message;
  } catch {
    // no JSON: the message above
  }
  return new ApiError(response.status, code, message);
}

async function call(method: string, path: string, body: unknown, etag: string): Promise<Response> {
  let response = await send(method, path, body, etag);
  if (response.status === 401 && path !== '/api/v1/session' && await reauthenticate()) {
    response = await send(method, path, body, etag);
  }
  if (response.ok || response.status === 304) {
    reportAnswer(response.headers.get('Date'));
    return response;
  }
  const error = await errorOf(response);
  if (error.away) reportSilence();
  else reportAnswer(response.headers.get('Date'));
  throw error;
}

async function jsonOf<T>(response: Response): Promise<T> {
  try {
    return await response.json() as T;
  } catch {
    reportSilence(); // ended in the middle of the answer
    throw new ApiError(0, 'UNAVAILABLE', 'The answer of the coordinator is not complete.');
  }
}

export async function get<T>(path: string): Promise<T> {
  return jsonOf<T>(await call('GET', path, undefined, ''));
}

// With the etag of an earlier answer, `value` is null if nothing has changed.
export async function getIfChanged<T>(path: string, etag: string): Promise<Answer<T>> {
  const response = await call('GET', path, undefined, etag);
  if (response.status === 304) return { value: null, etag };
  return { value: await jsonOf<T>(response), etag: response.headers.get('ETag') ?? '' };
}

export async function change<T>(method: 'POST' | 'PATCH' | 'DELETE', path: string, body?: unknown): Promise<T> {
  return jsonOf<T>(await call(method, path, body, ''));
}

export async function getText(path: string): Promise<string> {
  return (await call('GET', path, undefined, '')).text();
}

// All items of a list, page by page, at most `limit`.
export async function getAll<T>(path: string, field: string, limit: number, query: Record<string, string> = {}):
    Promise<{ items: T[]; complete: boolean }> {
  const items: T[] = [];
  let token = '';
  do {
    const parameters = new URLSearchParams({ ...query, pageSize: '1000', ...(token ? { pageToken: token } : {}) });
    const page = await get<Record<string, unknown>>(`${path}?${parameters}`);
    items.push(...((page[field] as T[] | undefined) ?? []));
    token = (page['nextPageToken'] as string | undefined) ?? '';
  } while (token && items.length < limit);
  return { items, complete: !token };
}

export function fileUrl(job: string, artifact: string): string {
  return `/files/${job}/${artifact.split('/').map(encodeURIComponent).join('/')}`;
}

// Unlike crypto.randomUUID, also on pages that are not secure.
export function requestId(): string {
  return [...crypto.getRandomValues(new Uint8Array(16))].map((b) => b.toString(16).padStart(2, '0')).join('');
}
