// What the job page says about the selected tile.
import type { Attempt, Job, Tile, View } from '../api/types';
import { type Child, h } from '../base/dom';
import { bytes, clockSeconds, duration, enumWords, lastPart, percent, plural } from '../base/format';
import { address } from '../router';
import { tileState } from './tile_layers';

export interface TilePanelFacts {
  job: Job;
  tile: Tile;
  attempts: Attempt[] | null; // of the tile; null: not loaded yet
  views: View[];
  retry: (() => void) | null; // null: not allowed
  select(tile: number): void;
}

export function outcomeWords(attempt: Attempt): string {
  if (attempt.outcome === 'ATTEMPT_OUTCOME_FAILED' && attempt.error) {
    return `failed: ${enumWords(attempt.error.errorClass, 'ERROR_CLASS_')}`;
  }
  return enumWords(attempt.outcome, 'ATTEMPT_OUTCOME_');
}

export function hasFailed(attempt: Attempt): boolean {
  return attempt.outcome === 'ATTEMPT_OUTCOME_FAILED' || attempt.outcome === 'ATTEMPT_OUTCOME_LEASE_EXPIRED';
}

function attemptItem(attempt: Attempt): HTMLElement {
  const start = attempt.startTime ? new Date(attempt.startTime) : null;
  const took = start && attempt.endTime ? duration((Date.parse(attempt.endTime) - start.getTime()) / 1000) : '';
  return h('li', { class: hasFailed(attempt) ? 'bad' : '' },
    h('div', {}, h('b', {}, attempt.title), ` · attempt ${attempt.attempt} · `,
      h('span', { class: hasFailed(attempt) ? 'bad-text' : '' }, outcomeWords(attempt))),
    h('div', { class: 'soft' }, attempt.worker && `${attempt.worker}${attempt.machine && ` on ${attempt.machine}`}`,
      start && ` · ${clockSeconds(start)}`, took && ` · ${took}`),
    attempt.error?.message && h('div', { class: 'reason' }, attempt.error.message));
}

const kShownAttempts = 60;

export function tilePanel({ job, tile, attempts, views, retry, select }: TilePanelFacts): HTMLElement {
  const state = tileState(tile);
  const fact = (name: string, ...value: Child[]) => [h('dt', {}, name), h('dd', {}, ...value)];
  const images = tile.views.map((index) => views[index]?.image).filter((image): image is string => Boolean(image));
  // The last attempts first; failed ones before all others.
  const sorted = attempts && [...attempts].sort((a, b) => Number(hasFailed(b)) - Number(hasFailed(a)) ||
    (b.startTime ?? '').localeCompare(a.startTime ?? ''));
  return h('section', { class: 'card panel', 'aria-label': `Tile ${tile.tile}`, 'data-key': `tile-${tile.tile}` },
    h('div', { class: 'head' }, h('h2', {}, `Tile ${tile.tile}`),
      h('button', { class: 'close', 'aria-label': 'Close the tile', onclick: () => select(-1) }, '×')),
    h('p', {}, h('span', { class: 'swatch', style: { background: state.color } }), h('b', {}, state.name),
      tile.title && ` · ${tile.title}`, tile.stage && `: ${tile.stage}`),
    tile.reasons.length > 0 && h('ul', { class: 'reasons' }, tile.reasons.map((reason) => h('li', {}, reason))),
    tile.waitsFor.length > 0 && h('p', {}, 'Waits for ', tile.waitsFor.slice(0, 20).map((other, i) => [i > 0 && ', ',
      h('button', { class: 'link', onclick: () => select(other) }, `tile ${other}`)]),
      tile.waitsFor.length > 20 && ` and ${tile.waitsFor.length - 20} more`, ' (outlined in the map).'),
    h('dl', { class: 'facts' },
      fact('Tasks', `${tile.tasksDone} of ${tile.tasksTotal} done`, tile.tasksReused > 0 && `, ${tile.tasksReused} reused`),
      fact('Attempts', String(tile.attempts), tile.failedAttempts > 0 &&
        h('span', { class: 'bad-text' }, `, ${tile.failedAttempts} failed`)),
      tile.worker && fact('Worker', tile.worker),
      fact('Processor time', duration(tile.coreSeconds), h('span', { class: 'soft' }, ` of ${duration(tile.predictedCoreSeconds)} predicted`)),
      fact('Memory', Number(tile.peakBytes) > 0 ? bytes(tile.peakBytes) : 'not known yet',
        h('span', { class: 'soft' }, ` of ${bytes(tile.predictedPeakBytes)} predicted`)),
      tile.confidence > 0 && fact('Confidence', `${percent(tile.confidence)} on average`),
      fact('Cameras', plural(tile.views.length, 'image'))),
    h('div', { class: 'buttons' },
      retry && h('button', { class: 'button small', onclick: retry }, 'Retry this tile'),
      h('a', { class: 'button small', href: address(`${job.name}/result`, { tile: tile.tile }) }, 'Show in 3D')),
    h('h3', {}, 'Attempts'),
    sorted === null ? h('p', { class: 'soft' }, 'Loading the attempts')
      : sorted.length === 0 ? h('p', { class: 'soft' }, tile.tasksReused > 0 ? 'None: its results were stored already.' : 'None yet.')
        : h('ol', { class: 'attempts' }, sorted.slice(0, kShownAttempts).map(attemptItem)),
    sorted && sorted.length > kShownAttempts && h('p', { class: 'soft' }, `and ${sorted.length - kShownAttempts} more; the view Time has all.`),
    images.length > 0 && h('details', {}, h('summary', {}, `Images (${images.length})`),
      h('ul', { class: 'names' }, images.map((image) => h('li', {}, image)))));
}

// Number of a job, for titles: "job 3".
export function jobNumber(job: Job): string {
  return `job ${lastPart(job.name)}`;
}
