// The workers of the coordinator.
import { getIfChanged } from '../api/client';
import { type Follower, poll } from '../api/live';
import type { Task, WatchJob, Worker } from '../api/types';
import { h, renderInto, scrollBox } from '../base/dom';
import { bytes, duration, lastPart, percent } from '../base/format';
import { address } from '../router';
import type { View } from './view';

const kInterval_ms = 2000, kMaxJobs = 6, kSilent_s = 15;

export function workersView(): View {
  const body = h('div');
  const element = h('div', { class: 'page' }, body);
  let workers: Worker[] = [], loaded = false, closed = false, fault = '';
  const tasks = new Map<string, Task>(); // what runs, by name
  const etags = new Map<string, string>();

  // Titles, progress and predicted memory of the tasks that run.
  async function loadTasks(): Promise<void> {
    const jobs = [...new Set(workers.flatMap((worker) => worker.tasks).map((task) => task.split('/tasks/')[0]))].slice(0, kMaxJobs);
    await Promise.all(jobs.map(async (job) => {
      try {
        const answer = await getIfChanged<WatchJob>(`/api/v1/${job}:state`, etags.get(job) ?? '');
        etags.set(job, answer.etag);
        for (const task of answer.value?.running ?? []) tasks.set(task.name, task);
      } catch {
        // Shown without them.
      }
    }));
    if (!closed) render();
  }

  const follower: Follower = poll<{ workers: Worker[] }>('/api/v1/workers?pageSize=1000', kInterval_ms, (list) => {
    workers = list.workers;
    loaded = true;
    fault = '';
    render();
    void loadTasks();
  }, (error) => {
    fault = error.message;
    render();
  });

  function state(worker: Worker): HTMLElement {
    if (worker.suspendedReason) return h('span', { class: 'badge partial' }, 'suspended');
    if (worker.lastSeenS > kSilent_s) return h('span', { class: 'badge failed' }, 'silent');
    if (worker.tasks.length > 0) return h('span', { class: 'badge running' }, 'works');
    return h('span', { class: 'badge queued' }, 'free');
  }

  function task(name: string): HTMLElement {
    const known = tasks.get(name), job = name.split('/tasks/')[0];
    return h('div', {},
      h('a', { href: address(job, known && known.tile >= 0 ? { tile: known.tile } : {}) }, known?.title ?? `task ${lastPart(name)}`),
      h('span', { class: 'soft' }, ` of job ${lastPart(job)}`, known && ` · ${percent(known.progress)}`, known?.stage && ` · ${known.stage}`));
  }

  function memory(worker: Worker): HTMLElement {
    const limit = Number(worker.memoryBytes);
    const used = worker.tasks.reduce((sum, name) => sum + Number(tasks.get(name)?.predictedPeakBytes ?? 0), 0);
    return h('div', {}, h('div', {}, used > 0 ? `${bytes(used)} of ${bytes(limit)}` : bytes(limit)),
      used > 0 && h('div', { class: 'bar small', 'aria-hidden': 'true' }, h('div', { style: { width: `${Math.min(100, (100 * used) / limit)}%` } })));
  }

  function render(): void {
    const busy = workers.filter((worker) => worker.tasks.length > 0).length;
    const suspended = workers.filter((worker) => worker.suspendedReason).length;
    renderInto(body,
      h('div', { class: 'head' }, h('h1', {}, 'Workers')),
      fault && h('p', { class: 'note bad' }, fault),
      loaded && workers.length > 0 && h('p', { class: 'soft' }, `${workers.length} registered, ${busy} work, ${suspended} suspended. Memory: predicted for the running task, of the limit.`),
      !loaded && !fault && h('p', { class: 'soft' }, 'Loading the workers'),
      loaded && workers.length === 0 && h('div', { class: 'empty' }, h('h2', {}, 'No workers'),
        h('p', {}, 'Jobs wait until a worker registers: ', h('code', {}, 'tessera-worker --coordinator HOST:PORT'), '.')),
      workers.length > 0 && scrollBox('Workers', h('table', { class: 'list cards' },
        h('thead', {}, h('tr', {}, ['Worker', 'State', 'Task', 'Memory', 'Last heard'].map((text) => h('th', { scope: 'col' }, text)))),
        h('tbody', {}, workers.map((worker) => h('tr', { 'data-key': worker.name },
          h('td', { class: 'name' }, h('b', {}, worker.host || worker.name), h('div', { class: 'soft' }, worker.name,
            worker.pid > 0 && ` · process ${worker.pid}`, ` · ${worker.threads} threads`, worker.allocation && ` · allocation ${worker.allocation}`,
            worker.timeLeftS > 0 && ` · ${duration(worker.timeLeftS)} left`)),
          h('td', { 'data-label': 'State' }, state(worker)),
          h('td', { class: 'wide', 'data-label': 'Task' }, worker.tasks.map(task),
            worker.suspendedReason && h('div', { class: 'stage warn-text' }, worker.suspendedReason,
              worker.suspendedS > 0 && ` (again in ${duration(worker.suspendedS)})`),
            worker.tasks.length === 0 && !worker.suspendedReason && h('span', { class: 'soft' }, 'none')),
          h('td', { 'data-label': 'Memory' }, memory(worker)),
          h('td', { 'data-label': 'Last heard' }, `${duration(worker.lastSeenS)} ago`)))))));
  }
  render();
  return { title: 'Workers', element, follow: (next) => next.parts[0] === 'workers', close() { closed = true; follower.stop(); } };
}
