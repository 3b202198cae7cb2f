// Who uses the page. The token is kept in this module's memory alone, so that the page logs in again after a restart of
// the coordinator, which forgets sessions.
import { ApiError, change, get, setReauthenticate } from './client';
import type { Session } from './types';

let session: Session | null = null;
let token = '';
let running: Promise<boolean> | null = null;
let onEnd: () => void = () => {};

export function currentSession(): Session | null {
  return session;
}

// `listener`: called when the session has ended and cannot be renewed.
export function onSessionEnd(listener: () => void): void {
  onEnd = listener;
}

export function may(method: string): boolean {
  return session?.may.includes(`/tessera.v1.Jobs/${method}`) ?? false;
}

// The session of the browser's cookie; null if there is none.
export async function openSession(): Promise<Session | null> {
  try {
    session = await get<Session>('/api/v1/session');
  } catch (error) {
    if (!(error instanceof ApiError) || error.away) throw error;
    session = null;
  }
  return session;
}

export async function logIn(given: string): Promise<void> {
  session = await change<Session>('POST', '/api/v1/session', { token: given });
  token = given;
}

export async function logOut(): Promise<void> {
  token = '';
  session = null;
  await change('DELETE', '/api/v1/session');
}

async function renew(): Promise<boolean> {
  if (token) {
    try {
      await logIn(token);
      return true;
    } catch (error) {
      if (error instanceof ApiError && error.away) return false;
      token = '';
    }
  }
  if (session) {
    session = null;
    onEnd();
  }
  return false;
}

setReauthenticate(() => {
  running ??= renew().finally(() => { running = null; });
  return running;
});
