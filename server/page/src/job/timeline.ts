// A strip of time for each worker: its attempts of the job's tasks, as `tessera fetch --timeline` writes them.
import { now_ms } from '../api/connection';
import type { Attempt, Job } from '../api/types';
import { h, renderInto } from '../base/dom';
import { duration, percent, plural } from '../base/format';
import { hasFailed, outcomeWords } from './tile_panel';

interface Slice { attempt: Attempt; start_s: number; end_s: number }
interface Row { worker: string; machine: string; slices: Slice[]; end_s: number }

const kRow_px = 24, kGap_px = 3, kAxis_px = 22, kMaxWidth_px = 12_000;
// One colour a kind of task, in the order in which kinds occur; each has contrast 3 to white and to the dark paper.
const kColors = ['#2f7fd6', '#3f9a64', '#a05fc4', '#c27b12', '#138f9c', '#c2477f', '#6f7fd8', '#7c8a2f', '#8a6d5a'];
const kFailed = '#d23b45', kOther = '#7d8791';

// Attempts of a worker that overlap in time are in several rows.
export function rowsOf(job: Job, attempts: Attempt[], now: number): Row[] {
  const zero = Date.parse(job.createTime ?? '') || 0, last = job.endTime ? Date.parse(job.endTime) : now;
  const slices = attempts.filter((attempt) => attempt.startTime).map((attempt) => {
    const start = Date.parse(attempt.startTime!);
    const end = attempt.endTime ? Date.parse(attempt.endTime) : last;
    return { attempt, start_s: (start - zero) / 1000, end_s: Math.max(start, end) / 1000 - zero / 1000 };
  }).sort((a, b) => a.start_s - b.start_s);
  const rows: Row[] = [];
  const ofWorker = new Map<string, Row[]>();
  for (const slice of slices) {
    const { worker, machine } = slice.attempt, key = `${machine}\n${worker}`;
    const own = ofWorker.get(key) ?? [];
    ofWorker.set(key, own);
    let row = own.find((each) => each.end_s <= slice.start_s + 1e-3);
    if (!row) {
      row = { worker, machine, slices: [], end_s: 0 };
      own.push(row);
      rows.push(row);
    }
    row.slices.push(slice);
    row.end_s = slice.end_s;
  }
  return rows.sort((a, b) => a.machine.localeCompare(b.machine) || a.worker.localeCompare(b.worker, 'en', { numeric: true }));
}

export class Timeline {
  readonly element = h('div', { class: 'timeline' });
  private readonly names = h('div', { class: 'row-names', 'aria-hidden': 'true' });
  private readonly canvas = h('canvas', { 'aria-hidden': 'true' });
  private readonly scroller = h('div', { class: 'strip', tabindex: 0, role: 'group', 'aria-label': 'Strip of time, scrolls sideways' }, this.canvas);
  private readonly legend = h('div', { class: 'legend' });
  private readonly hint = h('p', { class: 'soft hint' });
  private readonly table = h('div', { class: 'scroll', tabindex: 0, role: 'region', 'aria-label': 'Workers of the job' });
  private rows: Row[] = [];
  private kinds: string[] = [];
  private end_s = 1;
  private zoom = 1;

  constructor() {
    const bar = h('div', { class: 'mapbar' }, this.legend, h('span', { class: 'buttons' },
      h('button', { class: 'button small', 'aria-label': 'Longer', onclick: () => this.setZoom(this.zoom * 2) }, '+'),
      h('button', { class: 'button small', 'aria-label': 'Shorter', onclick: () => this.setZoom(this.zoom / 2) }, '−')));
    this.element.append(bar, h('div', { class: 'strips' }, this.names, this.scroller), this.hint, this.table);
    this.canvas.addEventListener('pointermove', (event) => this.showHint(event));
    this.canvas.addEventListener('click', (event) => {
      const slice = this.sliceAt(event);
      if (slice && slice.attempt.tile >= 0) location.hash = `${location.hash.split('/timeline')[0]}?tile=${slice.attempt.tile}`;
    });
    new ResizeObserver(() => this.draw()).observe(this.scroller);
  }

  set(job: Job, attempts: Attempt[], complete: boolean): void {
    this.rows = rowsOf(job, attempts, now_ms());
    for (const { kind } of attempts) if (!this.kinds.includes(kind)) this.kinds.push(kind);
    this.end_s = Math.max(1, ...this.rows.map((row) => row.end_s));
    renderInto(this.names, h('div', { class: 'axis' }), this.rows.map((row) => h('div', { title: row.machine }, row.worker || 'worker')));
    renderInto(this.legend, this.kinds.map((kind, i) => h('span', { class: 'entry' },
      h('i', { style: { background: kColors[i % kColors.length] } }), kind)),
      h('span', { class: 'entry' }, h('i', { style: { background: kFailed } }), 'failed or expired'));
    this.hint.textContent = complete ? 'Point at an attempt to see what it did; a click opens its tile.'
      : `Only the first ${plural(attempts.length, 'attempt')} are drawn.`;
    this.draw();
    this.renderTable();
  }

  private color(attempt: Attempt): string {
    if (hasFailed(attempt)) return kFailed;
    if (attempt.outcome === 'ATTEMPT_OUTCOME_CANCELLED') return kOther;
    return kColors[this.kinds.indexOf(attempt.kind) % kColors.length];
  }

  private setZoom(zoom: number): void {
    this.zoom = Math.min(Math.max(zoom, 1), 64);
    this.draw();
  }

  private draw(): void {
    const width = Math.min(Math.max(this.scroller.clientWidth, 100) * this.zoom, kMaxWidth_px);
    const height = kAxis_px + this.rows.length * (kRow_px + kGap_px);
    const ratio = Math.min(window.devicePixelRatio || 1, 16_000 / width);
    this.canvas.width = width * ratio;
    this.canvas.height = height * ratio;
    Object.assign(this.canvas.style, { width: `${width}px`, height: `${height}px` });
    const pen = this.canvas.getContext('2d');
    if (!pen) return;
    const style = getComputedStyle(this.element);
    pen.scale(ratio, ratio);
    pen.font = `12px ${style.fontFamily}`;
    pen.textBaseline = 'middle';
    const step_s = [1, 2, 5, 10, 20, 30, 60, 120, 300, 600, 1200, 1800, 3600, 7200, 14400, 43200, 86400]
      .find((s) => (s / this.end_s) * width > 80) ?? 604800;
    for (let s = 0; s <= this.end_s; s += step_s) {
      const x = (s / this.end_s) * width;
      pen.fillStyle = style.getPropertyValue('--line');
      pen.fillRect(x, kAxis_px - 4, 1, height);
      pen.fillStyle = style.getPropertyValue('--soft');
      if (x + 50 < width) pen.fillText(duration(s), x + 3, kAxis_px / 2);
    }
    this.rows.forEach((row, i) => {
      const y = kAxis_px + i * (kRow_px + kGap_px);
      for (const slice of row.slices) {
        const x = (slice.start_s / this.end_s) * width;
        const long = Math.max(1, ((slice.end_s - slice.start_s) / this.end_s) * width - 1);
        pen.fillStyle = this.color(slice.attempt);
        pen.fillRect(x, y, long, kRow_px);
        if (long < 46) continue;
        pen.save();
        pen.beginPath();
        pen.rect(x, y, long - 3, kRow_px);
        pen.clip();
        pen.fillStyle = '#ffffff';
        pen.fillText(slice.attempt.title, x + 5, y + kRow_px / 2);
        pen.restore();
      }
    });
  }

  private sliceAt(event: MouseEvent): Slice | null {
    const box = this.canvas.getBoundingClientRect();
    const row = this.rows[Math.floor((event.clientY - box.top - kAxis_px) / (kRow_px + kGap_px))];
    const at_s = ((event.clientX - box.left) / box.width) * this.end_s, slack_s = (2 / box.width) * this.end_s;
    return row?.slices.find((slice) => at_s >= slice.start_s - slack_s && at_s <= slice.end_s + slack_s) ?? null;
  }

  private showHint(event: MouseEvent): void {
    const slice = this.sliceAt(event);
    if (!slice) return;
    const { attempt } = slice;
    this.hint.textContent = `${attempt.title}, attempt ${attempt.attempt} on ${attempt.worker}: ${outcomeWords(attempt)}, ` +
      `${duration(slice.end_s - slice.start_s)}${attempt.error?.message ? `. ${attempt.error.message}` : ''}`;
  }

  private renderTable(): void {
    const workers = new Map<string, { machine: string; count: number; failed: number; busy_s: number }>();
    for (const row of this.rows) {
      const entry = workers.get(row.worker) ?? { machine: row.machine, count: 0, failed: 0, busy_s: 0 };
      for (const slice of row.slices) {
        ++entry.count;
        entry.failed += hasFailed(slice.attempt) ? 1 : 0;
        entry.busy_s += slice.end_s - slice.start_s;
      }
      workers.set(row.worker, entry);
    }
    renderInto(this.table, h('table', { class: 'list' },
      h('thead', {}, h('tr', {}, ['Worker', 'Machine', 'Attempts', 'Failed', 'Busy', 'Share of the time']
        .map((text, i) => h('th', { scope: 'col', class: i > 1 ? 'number' : '' }, text)))),
      h('tbody', {}, [...workers].map(([name, entry]) => h('tr', { 'data-key': name }, h('td', {}, name), h('td', {}, entry.machine),
        h('td', { class: 'number' }, String(entry.count)), h('td', { class: `number ${entry.failed ? 'bad-text' : ''}` }, String(entry.failed)),
        h('td', { class: 'number' }, duration(entry.busy_s)), h('td', { class: 'number' }, percent(Math.min(1, entry.busy_s / this.end_s))))))));
  }
}
