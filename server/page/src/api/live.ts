// Views that follow the coordinator: polls, and the stream of a job.
import { ApiError, getIfChanged } from './client';
import type { WatchJob } from './types';

export interface Follower { stop(): void; now(): void }

const kAwayInterval_ms = 2000;

// Gets `path` every `interval_ms` and calls `onChange` with what has changed. `onError`: refusals other than "away".
export function poll<T>(path: string, interval_ms: number, onChange: (value: T) => void,
                        onError: (error: ApiError) => void = () => {}): Follower {
  let etag = '', stopped = false, busy = false, timer: ReturnType<typeof setTimeout> | undefined;
  const step = async () => {
    clearTimeout(timer);
    if (stopped || busy) return;
    busy = true;
    let wait_ms = interval_ms;
    try {
      const answer = await getIfChanged<T>(path, etag);
      etag = answer.etag;
      if (answer.value !== null && !stopped) onChange(answer.value);
    } catch (error) {
      if (!(error instanceof ApiError)) throw error;
      if (error.away) wait_ms = Math.max(interval_ms, kAwayInterval_ms);
      else if (!stopped) onError(error);
    } finally {
      busy = false;
      if (!stopped) timer = setTimeout(step, document.hidden ? Math.max(wait_ms, 5000) : wait_ms);
    }
  };
  void step();
  const onShow = () => { if (!document.hidden) void step(); };
  document.addEventListener('visibilitychange', onShow);
  return {
    stop() {
      stopped = true;
      clearTimeout(timer);
      document.removeEventListener('visibilitychange', onShow);
    },
    now() { etag = ''; void step(); },
  };
}

const kPollInterval_ms = 2000, kHiddenInterval_ms = 5000, kEndedInterval_ms = 10_000, kStreamAgain_ms = 60_000;

// Follows a job: by its stream, or while the coordinator has none to give, by a poll every two seconds. A job that has
// ended is asked for rarely: it may be retried. A page in the background has no stream: a browser opens only six
// connections to a host.
export function watchJob(job: string, onMessage: (message: WatchJob) => void, onError: (error: ApiError) => void):
    Follower {
  let etag = '', stopped = false, ended = false, streamAfter_ms = 0;
  let stream: EventSource | null = null, timer: ReturnType<typeof setTimeout> | undefined;

  const deliver = (message: WatchJob) => {
    etag = message.etag;
    ended = !/QUEUED|RUNNING/.test(message.job.state);
    onMessage(message);
  };
  const close = () => {
    stream?.close();
    stream = null;
  };
  const openStream = () => {
    const query = etag ? `?seenEtag=${encodeURIComponent(etag)}` : '';
    const source = new EventSource(`/api/v1/${job}:watch${query}`);
    let opened = false;
    stream = source;
    source.onopen = () => { opened = true; };
    source.onmessage = (event) => { if (!stopped) deliver(JSON.parse(event.data) as WatchJob); };
    source.addEventListener('end', () => {
      close();
      ended = true;
      later(kEndedInterval_ms);
    });
    source.onerror = () => {
      if (stream !== source) return;
      close();
      // A stream that never opened: the coordinator has no further one, or is away. The poll finds out.
      if (!opened) streamAfter_ms = Date.now() + kStreamAgain_ms;
      later(opened ? 500 : 0);
    };
  };
  const step = async () => {
    if (stopped) return;
    try {
      const answer = await getIfChanged<WatchJob>(`/api/v1/${job}:state`, etag ? `"${etag.replaceAll('"', '')}"` : '');
      if (stopped) return;
      if (answer.value) deliver(answer.value);
      if (ended) later(kEndedInterval_ms);
      else if (document.hidden) later(kHiddenInterval_ms);
      else if (Date.now() >= streamAfter_ms) openStream();
      else later(kPollInterval_ms);
    } catch (error) {
      if (!(error instanceof ApiError)) throw error;
      if (error.away) {
        streamAfter_ms = 0;
        later(kAwayInterval_ms);
      } else if (!stopped) {
        onError(error);
        if (error.status !== 404 && error.status !== 401) later(5000);
      }
    }
  };
  const later = (wait_ms: number) => {
    clearTimeout(timer);
    timer = setTimeout(step, wait_ms);
  };
  void step();
  const onShow = () => {
    if (document.hidden) {
      close();
      later(kHiddenInterval_ms);
    } else if (!stream) {
      later(0);
    }
  };
  document.addEventListener('visibilitychange', onShow);
  return {
    stop() {
      stopped = true;
      clearTimeout(timer);
      document.removeEventListener('visibilitychange', onShow);
      close();
    },
    now() {
      close();
      etag = '';
      ended = false;
      void step();
    },
  };
}
