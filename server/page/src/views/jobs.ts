// The list of jobs.
import { get } from '../api/client';
import { type Follower, poll } from '../api/live';
import { may } from '../api/session';
import { hasEnded, hasResult, type Job, type ListJobs, jobTitle } from '../api/types';
import { notifyError } from '../base/dialog';
import { h, renderInto, scrollBox } from '../base/dom';
import { clock, lastPart, plural } from '../base/format';
import { allowedActions, apply } from '../job/actions';
import { costText, etaText, progressBar, stageText, stateBadge, stateName, timeLines } from '../job/status';
import { address, currentRoute, replaceQuery, type Route } from '../router';
import type { View } from './view';

const kInterval_ms = 1000, kPageSize = 100;
const kStates = ['running', 'queued', 'paused', 'succeeded', 'partial', 'failed', 'cancelled'];

export function jobsView(_route: Route): View {
  const body = h('div', { class: 'jobs' });
  const element = h('div', { class: 'page' }, body);
  let newest: Job[] = [], token = '', loaded = false, fault = '';
  let older: Job[] = [], olderToken: string | null = null; // pages after the first, as they were when they were loaded
  const selected = new Set<string>();

  const jobs = () => {
    const names = new Set(newest.map((job) => job.name));
    return [...newest, ...older.filter((job) => !names.has(job.name))];
  };
  const matches = (job: Job) => {
    const query = currentRoute().query;
    const state = query.get('state') ?? '', owner = query.get('owner') ?? '', text = (query.get('text') ?? '').toLowerCase();
    return (!state || (state === 'active' ? !hasEnded(job) : stateName(job) === state)) &&
      (!owner || job.owner === owner) &&
      (!text || `${job.displayName} ${job.name} ${job.scenePath}`.toLowerCase().includes(text));
  };

  const follower: Follower = poll<ListJobs>(`/api/v1/jobs?pageSize=${kPageSize}`, kInterval_ms, (list) => {
    newest = list.jobs;
    token = list.nextPageToken;
    loaded = true;
    fault = '';
    render();
  }, (error) => {
    fault = error.message;
    render();
  });
  const timer = setInterval(() => { if (!document.hidden) render(); }, 1000); // times go on

  async function loadOlder(): Promise<void> {
    try {
      const next = olderToken ?? token;
      const page = await get<ListJobs>(`/api/v1/jobs?pageSize=${kPageSize}&pageToken=${encodeURIComponent(next)}`);
      older = [...older, ...page.jobs];
      olderToken = page.nextPageToken;
      render();
    } catch (error) {
      notifyError(error);
    }
  }

  function filters(all: Job[]): HTMLElement {
    const query = currentRoute().query;
    const state = query.get('state') ?? '', owner = query.get('owner') ?? '';
    const count = (name: string) => all.filter((job) => stateName(job) === name).length;
    const owners = [...new Set(all.map((job) => job.owner).filter(Boolean))].sort();
    if (owner && !owners.includes(owner)) owners.push(owner);
    const set = (name: string) => (event: Event) => {
      replaceQuery({ [name]: (event.target as HTMLInputElement).value });
      render();
    };
    const active = all.filter((job) => !hasEnded(job)).length;
    return h('div', { class: 'filters' },
      h('label', {}, 'State', h('select', { id: 'filter-state', value: state, onchange: set('state') },
        h('option', { value: '' }, `all (${all.length})`), h('option', { value: 'active' }, `not ended (${active})`),
        kStates.map((name) => h('option', { value: name }, `${name} (${count(name)})`)))),
      h('label', {}, 'Owner', h('select', { id: 'filter-owner', value: owner, onchange: set('owner') },
        h('option', { value: '' }, 'all'), owners.map((name) => h('option', { value: name }, name)))),
      h('label', { class: 'grow' }, 'Name', h('input', {
        id: 'filter-text', type: 'search', value: query.get('text') ?? '', oninput: set('text'),
      })));
  }

  function toolbar(shown: Job[]): HTMLElement | null {
    const chosen = shown.filter((job) => selected.has(job.name));
    const actions = allowedActions();
    if (actions.length === 0) return null;
    return h('div', { class: 'toolbar', role: 'toolbar', 'aria-label': 'Selected jobs' },
      h('span', { class: 'soft' }, chosen.length === 0 ? 'Select jobs to change them'
        : `${plural(chosen.length, 'job')} selected`),
      actions.map((action) => h('button', {
        class: `button small ${action.danger ? 'danger-text' : ''}`, 'data-key': action.id,
        disabled: !chosen.some((job) => action.allows(job)),
        onclick: async () => {
          if (await apply(action, chosen)) {
            if (action.id === 'delete') older = older.filter((job) => !chosen.includes(job));
            selected.clear();
            follower.now();
            render();
          }
        },
      }, action.label)));
  }

  function row(job: Job, selectable: boolean): HTMLElement {
    const title = jobTitle(job), cost = costText(job), stage = stageText(job);
    const href = address(job.name);
    return h('tr', { 'data-key': job.name, class: selected.has(job.name) ? 'selected' : '' },
      selectable && h('td', { class: 'check' }, h('input', {
        type: 'checkbox', checked: selected.has(job.name), 'aria-label': `Select ${title}`,
        onchange: (event: Event) => {
          if ((event.target as HTMLInputElement).checked) selected.add(job.name);
          else selected.delete(job.name);
          render();
        },
      })),
      h('td', { class: 'name' },
        h('a', { href, class: 'title' }, title),
        h('div', { class: 'soft' }, `job ${lastPart(job.name)}`, job.owner && ` · ${job.owner}`,
          job.priority !== 0 && ` · priority ${job.priority}`)),
      h('td', { 'data-label': 'State' }, stateBadge(job)),
      h('td', { class: 'wide', 'data-label': 'Progress' }, progressBar(job, `Progress of ${title}`),
        stage && h('div', { class: job.error && hasEnded(job) ? 'stage bad-text' : 'stage' }, stage)),
      h('td', { 'data-label': 'Time', title: job.createTime ? `submitted ${clock(new Date(job.createTime))}` : null },
        timeLines(job).map((line, i) => h('div', { class: i ? 'soft' : '' }, line))),
      h('td', { 'data-label': hasEnded(job) ? 'End' : 'Time left' }, hasEnded(job) && 'ended ', etaText(job)),
      h('td', { class: 'cost', 'data-label': 'Cost' }, h('div', {}, cost.spent),
        h('div', { class: 'soft' }, cost.predicted ? (hasEnded(job) ? `predicted ${cost.predicted}` : `of ${cost.predicted}`) : 'not predicted yet')),
      h('td', { class: 'links' }, hasResult(job) &&
        h('a', { class: 'button small', href: address(`${job.name}/result`), 'aria-label': `Result of ${title} in 3D` }, '3D')));
  }

  function render(): void {
    const all = jobs(), shown = all.filter(matches);
    const selectable = allowedActions().length > 0;
    for (const name of selected) if (!all.some((job) => job.name === name)) selected.delete(name);
    const more = olderToken ?? token;
    const allChosen = shown.length > 0 && shown.every((job) => selected.has(job.name));
    renderInto(body,
      h('div', { class: 'head' }, h('h1', {}, 'Jobs'),
        may('CreateJob') && h('a', { class: 'button primary', href: address('submit') }, 'Submit a job')),
      fault && h('p', { class: 'note bad' }, fault),
      loaded && all.length > 0 && filters(all),
      loaded && all.length > 0 && toolbar(shown),
      !loaded && !fault && h('p', { class: 'soft' }, 'Loading the jobs'),
      loaded && all.length === 0 && h('div', { class: 'empty' }, h('h2', {}, 'No jobs yet'),
        h('p', {}, may('CreateJob') ? 'Submit a scene here, or with ' : 'Jobs are submitted with ',
          h('code', {}, 'tessera submit SCENE'), '.')),
      all.length > 0 && shown.length === 0 && h('p', { class: 'empty' }, 'No job matches the filters.'),
      shown.length > 0 && scrollBox('Jobs', h('table', { class: 'list cards' },
        h('thead', {}, h('tr', {},
          selectable && h('th', { class: 'check' }, h('input', {
            type: 'checkbox', 'aria-label': 'Select all jobs', checked: allChosen,
            indeterminate: !allChosen && shown.some((job) => selected.has(job.name)),
            onchange: (event: Event) => {
              const chosen = (event.target as HTMLInputElement).checked;
              for (const job of shown) if (chosen) selected.add(job.name); else selected.delete(job.name);
              render();
            },
          })),
          ['Name', 'State', 'Progress', 'Time', 'Time left', 'Cost'].map((text) => h('th', { scope: 'col' }, text)),
          h('th', {}, h('span', { class: 'unseen' }, 'Result')))),
        h('tbody', {}, shown.map((job) => row(job, selectable))))),
      more && shown.length < all.length && h('p', { class: 'soft center' }, `The filters search the ${all.length} newest jobs.`),
      more && h('p', { class: 'center' }, h('button', { class: 'button', onclick: loadOlder }, 'Load older jobs')));
  }
  render();
  return {
    title: 'Jobs', element,
    follow(next) {
      if ((next.parts[0] ?? 'jobs') !== 'jobs' || next.parts.length > 1) return false;
      render();
      return true;
    },
    close() {
      follower.stop();
      clearInterval(timer);
    },
  };
}
