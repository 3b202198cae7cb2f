// One job: its map and tiles, strip of time, energy, files, and settings.
import { type ApiError, change, fileUrl, get, getAll } from '../api/client';
import { type Follower, watchJob } from '../api/live';
import { may } from '../api/session';
import { type Artifact, type Attempt, hasEnded, hasResult, type Job, jobTitle, type Task, type Tile, type View as Camera, type WatchJob } from '../api/types';
import { notify, notifyError } from '../base/dialog';
import { type Child, fillIsland, h, renderInto, scrollBox } from '../base/dom';
import { clock, plural } from '../base/format';
import { allowedActions, apply } from '../job/actions';
import { energyCurves, energyPlot, type Report } from '../job/energy';
import { filesSection } from '../job/files';
import { settingsTable } from '../job/settings_list';
import { costText, etaText, progressBar, stageText, stateBadge, timeLines } from '../job/status';
import { isBad, tileState } from '../job/tile_layers';
import { TileMap } from '../job/tile_map';
import { jobNumber, tilePanel } from '../job/tile_panel';
import { Timeline } from '../job/timeline';
import { address, currentRoute, replaceQuery, type Route } from '../router';
import { Refresher } from './refresher';
import { prepareResult } from './result';
import type { View } from './view';

const kSections = [['', 'Tiles'], ['timeline', 'Time'], ['energy', 'Energy'], ['files', 'Files'], ['details', 'Details']];
const kTile_ms = 8; // between two lists of tiles, a tile: many pages ask the coordinator
const kMaxTiles = 100_000, kMaxAttempts = 50_000, kShownProblems = 20;

export function jobView(name: string, route: Route): View {
  const body = h('div');
  const element = h('div', { class: 'page' }, body);
  let section = route.parts[2] ?? '', tile = Number(route.query.get('tile') ?? -1);
  let job: Job | null = null, running: Task[] = [], fault = '', closed = false;
  let tiles: Tile[] = [], cameras: Camera[] = [], artifacts: Artifact[] | null = null;
  let attempts: Attempt[] | null = null, attemptsComplete = true, ofTile: { tile: number; attempts: Attempt[] } | null = null, report: Report | null | 'missing' = null;
  let showTable = false;
  const openFolders = new Set<string>();
  const map = new TileMap(select);
  const timeline = new Timeline();

  const load = (fetch: () => Promise<void>) => async () => {
    try {
      await fetch();
      if (!closed) render();
    } catch (error) {
      const refused = error as ApiError;
      if (refused.status !== 404 && !refused.away) throw error;
    }
  };
  const tileList = new Refresher(1000, load(async () => {
    tiles = (await getAll<Tile>(`/api/v1/${name}/tiles`, 'tiles', kMaxTiles)).items;
    tileList.interval_ms = Math.min(Math.max(1000, kTile_ms * tiles.length), 30_000);
    map.setTiles(tiles);
    if (section === '' && cameras.length === 0 && tiles.some((each) => each.views.length > 0)) cameraList.request();
  }));
  const attemptList = new Refresher(3000, load(async () => {
    const list = await getAll<Attempt>(`/api/v1/${name}/attempts`, 'attempts', kMaxAttempts);
    [attempts, attemptsComplete] = [list.items, list.complete];
  }));
  const tileAttempts = new Refresher(1000, load(async () => {
    const asked = tile;
    if (asked < 0) return;
    const list = await getAll<Attempt>(`/api/v1/${name}/attempts`, 'attempts', kMaxAttempts, { tile: String(asked) });
    ofTile = { tile: asked, attempts: list.items };
  }));
  const cameraList = new Refresher(1000, load(async () => {
    if (cameras.length > 0) return;
    cameras = (await getAll<Camera>(`/api/v1/${name}/views`, 'views', 200_000)).items;
    map.setViews(cameras);
  }));
  const fileList = new Refresher(5000, load(async () => {
    artifacts = (await getAll<Artifact>(`/api/v1/${name}/artifacts`, 'artifacts', 100_000)).items;
  }));
  const reportFile = new Refresher(5000, load(async () => {
    report = 'missing';
    if (job?.artifacts.some((artifact) => artifact.name === 'report.json')) {
      report = await get<Report>(fileUrl(name, 'report.json'));
    }
  }));

  // Loads what the section shows, after each change of the job.
  function loadSection(): void {
    tileList.request();
    if (section === 'timeline') attemptList.request();
    if (section === '' && tile >= 0) tileAttempts.request();
    if (section === 'files') fileList.request();
    if (section === 'energy') reportFile.request();
  }

  const follower: Follower = watchJob(name, (message: WatchJob) => {
    job = message.job;
    running = message.running;
    fault = '';
    loadSection();
    render();
  }, (error) => {
    fault = error.status === 404 ? 'There is no such job. It may have been deleted.' : error.message;
    render();
  });
  const timer = setInterval(() => { if (!document.hidden && job && !hasEnded(job)) render(); }, 1000);

  function select(chosen: number): void {
    tile = chosen;
    map.select(tile);
    replaceQuery({ tile: tile >= 0 ? String(tile) : undefined });
    if (tile >= 0) tileAttempts.request();
    render();
  }

  // Selects a tile and moves the map with its panel into view.
  function goTo(chosen: number): void {
    if (section !== '') {
      location.hash = address(name, { tile: chosen });
      return;
    }
    select(chosen);
    body.querySelector('.split')?.scrollIntoView({ block: 'start', behavior: matchMedia('(prefers-reduced-motion: reduce)').matches ? 'auto' : 'smooth' });
  }

  async function retryTile(chosen: number): Promise<void> {
    try {
      await change('POST', `/api/v1/${name}:retry`, { tile: chosen });
      notify(`Tile ${chosen} is tried again.`);
      follower.now();
    } catch (error) {
      notifyError(error);
    }
  }

  const canRetry = () => job !== null && may('RetryJob') && (job.state === 'JOB_STATE_FAILED' || job.state === 'JOB_STATE_PARTIAL');

  function summary(now: Job): HTMLElement {
    const cost = costText(now), bad = tiles.filter(isBad).length;
    const card = (title: string, value: Child, ...more: Child[]) => h('div', { class: 'figure' }, h('dt', {}, title), h('dd', {}, value),
      more.map((text) => text && h('dd', { class: 'soft' }, text)));
    const [ran, wait] = timeLines(now);
    return h('dl', { class: 'figures' },
      card('Tiles', now.tilesTotal > 0 ? `${now.tilesDone} of ${now.tilesTotal}` : 'not planned yet', bad > 0 ? plural(bad, 'tile failed', 'tiles failed') : ''),
      card('Tasks', now.tasksTotal > 0 ? `${now.tasksDone} of ${now.tasksTotal}` : 'not planned yet'),
      card('Time', ran, [wait, now.createTime && `submitted ${clock(new Date(now.createTime))}`].filter(Boolean).join(', ')),
      card(hasEnded(now) ? 'End' : 'Time left', etaText(now)),
      card('Cost', cost.spent, cost.predicted ? `predicted ${cost.predicted}` : 'not predicted yet'),
      card('Priority', String(now.priority)));
  }

  function problems(now: Job): HTMLElement | null {
    const bad = tiles.filter(isBad);
    const faults = tiles.filter((each) => !isBad(each) && each.failedAttempts > 0 && each.reasons.length > 0 && !hasEnded(now));
    if (bad.length === 0 && faults.length === 0 && !now.error) return null;
    const item = (each: Tile) => h('li', { 'data-key': each.tile },
      h('button', { class: 'link', onclick: () => goTo(each.tile) }, h('b', {}, `Tile ${each.tile}`)),
      ` ${isBad(each) ? tileState(each).name : 'is tried again'}${each.title && ` · ${each.title}`}${each.worker && ` on ${each.worker}`}`,
      h('div', { class: 'reason' }, each.reasons[0] ?? 'No reason was reported.'));
    return h('section', { class: `note ${bad.length > 0 || now.error ? 'bad' : 'warn'} problems`, 'aria-label': 'Problems' },
      h('h2', {}, bad.length > 0 ? plural(bad.length, 'tile failed', 'tiles failed') : now.error ? 'The job failed' : 'Attempts failed'),
      now.error && h('p', { class: 'reason' }, now.error),
      h('ul', {}, [...bad, ...faults].slice(0, kShownProblems).map(item)),
      bad.length + faults.length > kShownProblems && h('p', {}, `and ${bad.length + faults.length - kShownProblems} more in the map`));
  }

  function tileTable(): HTMLElement {
    return h('details', { class: 'card', ontoggle: (event: Event) => { showTable = (event.target as HTMLDetailsElement).open; render(); } },
      h('summary', {}, `All tiles as a table (${tiles.length})`),
      showTable && scrollBox('Tiles', h('table', { class: 'list' },
        h('thead', {}, h('tr', {}, ['Tile', 'State', 'Tasks', 'Attempts', 'Now'].map((text) => h('th', { scope: 'col' }, text)))),
        h('tbody', {}, tiles.slice(0, 500).map((each) => h('tr', { 'data-key': each.tile },
          h('td', {}, h('button', { class: 'link', onclick: () => goTo(each.tile) }, String(each.tile))),
          h('td', {}, tileState(each).name), h('td', {}, `${each.tasksDone} of ${each.tasksTotal}`), h('td', {}, String(each.attempts)),
          h('td', {}, each.title)))))),
      showTable && tiles.length > 500 && h('p', { class: 'soft' }, 'The first 500 tiles.'));
  }

  function tilesSection(now: Job): Child {
    const chosen = tiles.find((each) => each.tile === tile);
    return [h('div', { class: chosen ? 'split' : 'split alone' },
      h('section', { class: 'card', 'aria-label': 'Map of the tiles' },
        tiles.some((each) => each.core.length > 0) ? h('div', { 'data-island': 'map' })
          : h('p', { class: 'empty' }, tiles.length > 0 ? 'The place of the tiles is not known.' : hasEnded(now) ? 'The job has no tiles.'
            : 'The tiles are planned when the scene has been read.')),
      chosen ? tilePanel({
        job: now, tile: chosen, attempts: ofTile?.tile === tile ? ofTile.attempts : null, views: cameras,
        retry: canRetry() && isBad(chosen) ? () => void retryTile(tile) : null, select,
      }) : null),
    !chosen && tiles.length > 0 && h('p', { class: 'soft' }, 'A click on a tile shows its attempts, errors and cameras.'),
    running.length > 0 && h('section', { class: 'card' }, h('h2', {}, `Running now (${running.length})`),
      h('ul', { class: 'running-list' }, running.slice(0, 50).map((task) => h('li', { 'data-key': task.name },
        task.tile >= 0 ? h('button', { class: 'link', onclick: () => goTo(task.tile) }, task.title) : task.title,
        h('span', { class: 'soft' }, `${task.stage && ` · ${task.stage}`} · ${task.worker}`),
        h('div', { class: 'bar small', 'aria-hidden': 'true' }, h('div', { style: { width: `${100 * task.progress}%` } })))))),
    tiles.length > 0 && tileTable()];
  }

  function details(now: Job): Child {
    const reused = tiles.reduce((sum, each) => sum + each.tasksReused, 0), total = tiles.reduce((sum, each) => sum + each.tasksTotal, 0);
    const kept = tiles.filter((each) => each.state === 'TILE_STATE_KEPT').length;
    const full = tiles.filter((each) => each.tasksTotal > 0 && each.tasksReused === each.tasksTotal);
    return [
      h('section', { class: 'card' }, h('h2', {}, `Warnings (${now.warnings.length})`),
        now.warnings.length === 0 ? h('p', { class: 'soft' }, 'None.') : h('ul', { class: 'reasons' }, now.warnings.map((text) => h('li', {}, text)))),
      h('section', { class: 'card' }, h('h2', {}, 'Reused'),
        h('p', {}, reused === 0 ? 'No result of an earlier job was reused.' : `${reused} of the ${total} tasks of tiles found their result stored; nothing ran for them.`),
        full.length > 0 && h('p', {}, `Reused completely: tiles ${full.slice(0, 100).map((each) => each.tile).join(', ')}${full.length > 100 ? ', …' : ''}.`),
        kept > 0 && h('p', {}, `${plural(kept, 'tile keeps', 'tiles keep')} the result of the base job `,
          now.settings?.update?.base && h('a', { href: address(now.settings.update.base) }, now.settings.update.base), '.')),
      h('section', { class: 'card' }, h('h2', {}, 'Settings'), settingsTable(now))];
  }

  function energy(): Child {
    if (report === null) return h('p', { class: 'soft' }, 'Loading report.json');
    const curves = report === 'missing' ? [] : energyCurves(report);
    if (curves.length === 0) {
      return h('p', { class: 'soft' }, report === 'missing' ? 'The energy is known when the job has published report.json.' : 'report.json has no energies.');
    }
    return h('section', { class: 'card' }, h('h2', {}, 'Energy by round'), energyPlot(curves));
  }

  function content(now: Job): Child {
    if (section === 'timeline') return h('section', { class: 'card' }, h('h2', {}, 'Attempts by worker'),
      attempts === null ? h('p', { class: 'soft' }, 'Loading the attempts') : attempts.length === 0 ? h('p', { class: 'soft' }, 'No task has run yet.')
        : h('div', { 'data-island': 'timeline' }));
    if (section === 'energy') return energy();
    if (section === 'files') return h('section', { class: 'card' }, h('h2', {}, 'Files'), filesSection(now, artifacts, openFolders, render));
    if (section === 'details') return details(now);
    return tilesSection(now);
  }

  function render(): void {
    if (!job) {
      renderInto(body, h('p', { class: 'crumbs' }, h('a', { href: address('jobs') }, 'Jobs')), h('h1', {}, name),
        h('p', { class: fault ? 'note bad' : 'soft' }, fault || 'Loading the job'));
      return;
    }
    const now = job, stage = stageText(now);
    renderInto(body,
      h('p', { class: 'crumbs' }, h('a', { href: address('jobs') }, 'Jobs'), ` / ${jobNumber(now)}`),
      h('div', { class: 'head' }, h('h1', {}, jobTitle(now), ' ', stateBadge(now)),
        h('div', { class: 'buttons' },
          hasResult(now) && h('a', {
            class: 'button primary', href: address(`${name}/result`), onpointerenter: () => prepareResult(name), onfocus: () => prepareResult(name),
          }, 'Result in 3D'),
          allowedActions().filter((action) => action.allows(now)).map((action) => h('button', {
            class: `button ${action.danger ? 'danger-text' : ''}`, 'data-key': action.id,
            onclick: async () => {
              if (!await apply(action, [now])) return;
              if (action.id === 'delete') location.hash = address('jobs');
              else follower.now();
            },
          }, action.label)))),
      fault && h('p', { class: 'note bad' }, fault),
      h('p', { class: 'soft' }, now.scenePath, now.owner && ` · submitted by ${now.owner}`),
      h('div', { class: 'main-progress' }, progressBar(now, 'Progress of the job'), !now.error && stage && h('p', { class: 'stage' }, stage)),
      summary(now), problems(now),
      h('nav', { class: 'tabs', 'aria-label': 'Parts of the job' }, kSections.map(([id, title]) => h('a', {
        href: address(id ? `${name}/${id}` : name), 'aria-current': section === id ? 'page' : null,
      }, title, id === 'details' && now.warnings.length > 0 && h('span', { class: 'count' }, String(now.warnings.length),
        h('span', { class: 'unseen' }, ' warnings'))))),
      h('div', { class: 'content', 'data-key': `section ${section}` }, content(now)));
    fillIsland(body, 'map', map.element);
    fillIsland(body, 'timeline', timeline.element);
    if (section === 'timeline' && attempts) timeline.set(now, attempts, attemptsComplete);
  }

  map.select(tile);
  render();
  const view: View = {
    title: name, element,
    follow(next) {
      if (next.parts[0] !== 'jobs' || `jobs/${next.parts[1]}` !== name || next.parts[2] === 'result') return false;
      section = next.parts[2] ?? '';
      const chosen = Number(currentRoute().query.get('tile') ?? -1);
      if (chosen !== tile) {
        tile = chosen;
        map.select(tile);
      }
      if (job) loadSection();
      render();
      return true;
    },
    close() {
      closed = true;
      follower.stop();
      clearInterval(timer);
    },
  };
  Object.defineProperty(view, 'title', { get: () => (job ? `${jobTitle(job)} · ${Math.floor(100 * job.progress)} %` : name) });
  return view;
}
