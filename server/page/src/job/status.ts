// State, progress, times and cost of a job, as elements and text.
import { now_ms } from '../api/connection';
import { hasEnded, type Job } from '../api/types';
import { h } from '../base/dom';
import { clock, coreTime, duration, durationRange, enumWords, percent } from '../base/format';

export function stateName(job: Job): string {
  return job.paused && !hasEnded(job) ? 'paused' : enumWords(job.state, 'JOB_STATE_');
}

export function stateBadge(job: Job): HTMLElement {
  const name = stateName(job);
  return h('span', { class: `badge ${name}` }, name);
}

// The stage in words, or why the job waits or ended.
export function stageText(job: Job): string {
  if (hasEnded(job)) return job.error.split('\n')[0];
  if (job.waitingFor) return job.waitingFor;
  if (job.stage) return job.stage;
  return job.tasksTotal > 0 ? `${job.tasksDone} of ${job.tasksTotal} tasks` : '';
}

export function progressBar(job: Job, label: string): HTMLElement {
  const share = job.state === 'JOB_STATE_SUCCEEDED' ? 1 : Math.min(Math.max(job.progress, 0), 1);
  return h('div', { class: 'progress' },
    h('div', {
      class: `bar ${stateName(job)}`, role: 'progressbar', 'aria-label': label, 'aria-valuemin': 0,
      'aria-valuemax': 100, 'aria-valuenow': Math.floor(100 * share),
    }, h('div', { style: { width: `${100 * share}%` } })),
    h('span', { class: 'share' }, percent(share)));
}

function seconds(from: string | undefined, to: string | undefined): number {
  if (!from) return 0;
  return Math.max(0, ((to ? Date.parse(to) : now_ms()) - Date.parse(from)) / 1000);
}

// Time that a job waited for its first task, and that it has run.
export function waited_s(job: Job): number {
  return seconds(job.createTime, job.startTime ?? job.endTime);
}

export function ran_s(job: Job): number {
  return job.startTime ? seconds(job.startTime, job.endTime) : 0;
}

export function timeLines(job: Job): string[] {
  const waited = waited_s(job);
  const wait = waited >= 1 ? `waited ${duration(waited)}` : '';
  if (!job.startTime) return [hasEnded(job) ? 'never started' : `waiting for ${duration(waited)}`];
  const ran = duration(ran_s(job));
  return [hasEnded(job) ? `took ${ran}` : `running for ${ran}`, wait].filter(Boolean);
}

export function etaText(job: Job): string {
  if (hasEnded(job)) return job.endTime ? clock(new Date(job.endTime)) : '';
  if (job.etaLowS >= 0 && job.etaHighS > 0) return durationRange(job.etaLowS, job.etaHighS);
  if (job.etaS > 0) return `about ${duration(job.etaS)}`;
  return 'not known yet';
}

export function costText(job: Job): { spent: string; predicted: string } {
  return {
    spent: coreTime(job.coreSeconds),
    predicted: job.predictedCoreSeconds > 0 ? coreTime(job.predictedCoreSeconds) : '',
  };
}
