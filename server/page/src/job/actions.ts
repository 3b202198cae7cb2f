// Changes of jobs: which a job allows, and how they are asked for.
import { change } from '../api/client';
import { may } from '../api/session';
import { hasEnded, type Job, jobTitle } from '../api/types';
import { ask, notify, notifyError } from '../base/dialog';
import { h } from '../base/dom';
import { plural } from '../base/format';

export interface Action {
  id: string;
  label: string;
  method: string; // of the service Jobs; the caller needs the right to call it
  danger?: boolean;
  allows(job: Job): boolean;
  run(job: Job, value: number): Promise<unknown>;
  done: string; // "paused"
  text: string; // what it means, for the question; empty: no question
}

export const kActions: Action[] = [
  {
    id: 'pause', label: 'Pause', method: 'ChangeJob', done: 'paused', text: '',
    allows: (job) => !hasEnded(job) && !job.paused,
    run: (job) => change('PATCH', `/api/v1/${job.name}`, { paused: true }),
  }, {
    id: 'resume', label: 'Resume', method: 'ChangeJob', done: 'resumed', text: '',
    allows: (job) => !hasEnded(job) && job.paused,
    run: (job) => change('PATCH', `/api/v1/${job.name}`, { paused: false }),
  }, {
    id: 'priority', label: 'Priority…', method: 'ChangeJob', done: 'changed',
    text: 'Free workers take tasks of the highest priority first.',
    allows: (job) => !hasEnded(job),
    run: (job, value) => change('PATCH', `/api/v1/${job.name}`, { priority: value }),
  }, {
    id: 'retry', label: 'Retry', method: 'RetryJob', done: 'retried',
    text: 'What failed is tried again. All results that succeeded are kept.',
    allows: (job) => job.state === 'JOB_STATE_FAILED' || job.state === 'JOB_STATE_PARTIAL',
    run: (job) => change('POST', `/api/v1/${job.name}:retry`, {}),
  }, {
    id: 'cancel', label: 'Cancel…', method: 'CancelJob', done: 'cancelled', danger: true,
    text: 'Running tasks are stopped. A cancelled job cannot go on; a new job finds the results that are stored.',
    allows: (job) => !hasEnded(job),
    run: (job) => change('POST', `/api/v1/${job.name}:cancel`, {}),
  }, {
    id: 'delete', label: 'Delete…', method: 'DeleteJob', done: 'deleted', danger: true,
    text: 'The job and its files are deleted. This cannot be undone.',
    allows: hasEnded,
    run: (job) => change('DELETE', `/api/v1/${job.name}`),
  },
];

const kShownNames = 12;

// Asks where needed, then applies the action to the jobs that allow it. Whether it was applied to any.
export async function apply(action: Action, jobs: Job[]): Promise<boolean> {
  const concerned = jobs.filter((job) => action.allows(job));
  if (concerned.length === 0) return false;
  let value = 0;
  if (action.text) {
    const label = action.label.replace('…', '');
    const one = concerned.length === 1;
    const answer = await ask({
      title: one ? `${label}: ${jobTitle(concerned[0])}` : `${label}: ${plural(concerned.length, 'job')}`,
      text: [h('p', {}, action.text),
        !one && h('ul', {}, concerned.slice(0, kShownNames).map((job) => h('li', {}, jobTitle(job))),
          concerned.length > kShownNames && h('li', {}, `and ${concerned.length - kShownNames} more`))],
      button: action.id === 'priority' ? 'Set priority' : one ? `${label} the job`
        : `${label} ${plural(concerned.length, 'job')}`,
      danger: action.danger,
      integer: action.id === 'priority'
        ? { label: 'Priority, −100 to 100', low: -100, high: 100, value: concerned[0].priority } : undefined,
    });
    if (answer === null) return false;
    if (typeof answer === 'number') value = answer;
  }
  const results = await Promise.allSettled(concerned.map((job) => action.run(job, value)));
  const failed = results.filter((result): result is PromiseRejectedResult => result.status === 'rejected');
  for (const failure of failed.slice(0, 3)) notifyError(failure.reason);
  if (failed.length < concerned.length) {
    const done = concerned.length - failed.length;
    notify(concerned.length === 1 ? `${jobTitle(concerned[0])}: ${action.done}.` : `${plural(done, 'job')} ${action.done}.`);
  }
  return failed.length < concerned.length;
}

// The actions that the caller may use at all.
export function allowedActions(): Action[] {
  return kActions.filter((action) => may(action.method));
}
