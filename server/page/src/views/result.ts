// The result of a job in 3D: finds its tile set, or lets a job export one; without WebGL it shows pictures.
import { ApiError, fileUrl, get, getText } from '../api/client';
import { readTileset, requestTileset, type Tileset } from '../api/early';
import { type Follower, watchJob } from '../api/live';
import { hasEnded, hasResult, type Job, jobTitle, type ListJobs, type WatchJob } from '../api/types';
import { type Child, h, renderInto } from '../base/dom';
import { lastPart } from '../base/format';
import { canExport, exportTiles, isTilesExport, kStartTileset, kTileset } from '../job/files';
import { progressBar, stageText, stateBadge } from '../job/status';
import { address, currentRoute, type Route } from '../router';
import type { Report, ResultPanel } from '../scene/result_panel';
import type { View } from './view';

async function hasFile(job: Job, name: string): Promise<boolean> {
  if (job.artifacts.some((artifact) => artifact.name === name)) return true;
  if (job.artifactsTotal <= job.artifacts.length) return false;
  const list = await get<{ artifacts: { name: string }[] }>(`/api/v1/${job.name}/artifacts?namePrefix=${encodeURIComponent(name)}`);
  return list.artifacts.some((artifact) => artifact.name === name);
}

// Asks for what a result in 3D needs first. To be called as soon as it is known that one will be shown.
export function prepareResult(name: string): void {
  if (typeof WebGL2RenderingContext === 'undefined') return;
  import('../scene/result_panel').catch(() => {}); // show() reports it
  requestTileset(name, kTileset);
}

export function resultView(name: string, _route: Route): View {
  const head = h('div', { class: 'result-head' }), body = h('div', { class: 'result-body' });
  const element = h('div', { class: 'result-page' }, head, body);
  let job: Job | null = null, panel: ResultPanel | null = null, follower: Follower | null = null, closed = false;

  function renderHead(): void {
    renderInto(head,
      h('p', { class: 'crumbs' }, h('a', { href: address('jobs') }, 'Jobs'), ' / ', h('a', { href: address(name) }, `job ${lastPart(name)}`), ' / result'),
      h('h1', {}, job ? jobTitle(job) : name, ' ', job && stateBadge(job)));
  }

  function say(...content: Child[]): void {
    panel?.close();
    panel = null;
    renderInto(body, h('div', { class: 'card message' }, ...content));
  }

  prepareResult(name);

  async function open(): Promise<void> {
    renderHead();
    say(h('p', { class: 'soft' }, 'Loading the job'));
    job = await get<Job>(`/api/v1/${name}`);
    renderHead();
    if (!hasResult(job)) {
      say(h('h2', {}, 'No result yet'), h('p', {}, hasEnded(job) ? 'The job ended without a result.' : 'The job has not ended.'),
        h('a', { class: 'button', href: address(name) }, 'To the job'));
      return;
    }
    if (typeof WebGL2RenderingContext === 'undefined') {
      await showPictures(job, 'This browser has no WebGL 2.');
      return;
    }
    const tileset = await readTileset(fileUrl(name, kTileset));
    if (tileset) {
      await show(job, job, tileset);
      return;
    }
    const list = await get<ListJobs>('/api/v1/jobs?pageSize=1000');
    const exported = list.jobs.find((each) => isTilesExport(each, name));
    if (exported) await follow(exported);
    else offerExport(job);
  }

  function offerExport(base: Job): void {
    say(h('h2', {}, 'The result has no 3D tiles yet'),
      h('p', {}, 'The page draws the export format 3dtiles. A job can write it from the result; nothing is computed again.'),
      canExport(base) ? h('button', { class: 'button primary', onclick: async () => {
        try {
          await follow(await exportTiles(base));
        } catch (error) {
          fail(error);
        }
      } }, 'Export 3D tiles') : h('p', { class: 'soft' }, 'Your role may not start jobs: ask somebody who may submit.'));
  }

  // Shows the progress of the job that exports, then its tiles.
  async function follow(exporting: Job): Promise<void> {
    follower?.stop();
    if (hasResult(exporting)) {
      await showExported(await get<Job>(`/api/v1/${exporting.name}`));
      return;
    }
    follower = watchJob(exporting.name, (message: WatchJob) => {
      const now = message.job;
      if (closed) return;
      if (hasResult(now)) {
        follower?.stop();
        void showExported(now).catch(fail);
      } else if (hasEnded(now)) {
        follower?.stop();
        say(h('h2', {}, 'The export failed'), h('p', { class: 'reason' }, now.error), h('a', { class: 'button', href: address(now.name) }, 'To the export job'));
      } else {
        say(h('h2', {}, 'The 3D tiles are being written'), progressBar(now, 'Progress of the export'), h('p', { class: 'stage' }, stageText(now)),
          h('a', { class: 'button small', href: address(now.name) }, 'To the export job'));
      }
    }, fail);
  }

  async function showExported(exported: Job): Promise<void> {
    requestTileset(exported.name, kTileset);
    const tileset = await readTileset(fileUrl(exported.name, kTileset));
    if (!tileset) throw new Error(`The export ${exported.name} has no tile set.`);
    await show(job!, exported, tileset);
  }

  async function show(base: Job, tiles: Job, tileset: Tileset): Promise<void> {
    const resultUrl = fileUrl(tiles.name, kTileset), startUrl = fileUrl(tiles.name, kStartTileset), transform = tileset.root?.transform ?? null;
    const report = get<Report>(fileUrl(base.name, 'report.json')).catch(() => ({} as Report)); // may be large: not waited for
    const [start, scene] = await Promise.all([hasFile(tiles, kStartTileset), import('../scene/result_panel')]);
    const facts = {
      job: base, result: { url: resultUrl, transform }, start: start ? { url: startUrl, transform } : null,
      report, fileColor: tiles.settings?.export?.color || 'class',
    };
    if (closed) return;
    try {
      panel = new scene.ResultPanel(facts);
      body.replaceChildren(panel.element);
    } catch (error) {
      await showPictures(base, error instanceof Error ? error.message : String(error));
    }
  }

  // The pictures of report.html. Its text is parsed, not run: only images that it contains are taken.
  async function showPictures(base: Job, why: string): Promise<void> {
    let figures: HTMLElement[] = [];
    try {
      const page = new DOMParser().parseFromString(await getText(fileUrl(base.name, 'report.html')), 'text/html');
      figures = [...page.querySelectorAll('figure')].flatMap((figure) => {
        const source = figure.querySelector('img')?.getAttribute('src') ?? '', text = figure.querySelector('figcaption')?.textContent ?? '';
        return source.startsWith('data:image/') ? [h('figure', {}, h('img', { src: source, alt: text || 'A picture of the result' }), h('figcaption', { class: 'soft' }, text))] : [];
      }).slice(0, 4);
    } catch {
      // No report: the sentence alone.
    }
    renderInto(body, h('div', { class: 'page' }, h('div', { class: 'note warn' }, h('b', {}, 'No 3D view. '), why,
      figures.length > 0 ? ' These are the pictures of the report.' : ''),
    h('div', { class: 'pictures' }, figures),
    h('p', { class: 'buttons' }, h('a', { class: 'button', href: fileUrl(base.name, 'report.html'), target: '_blank', rel: 'noopener' }, 'Open the report'),
      h('a', { class: 'button', href: address(`${name}/files`) }, 'Files'))));
  }

  function fail(error: unknown): void {
    if (closed) return;
    if (error instanceof ApiError && error.away) {
      setTimeout(() => { if (!closed && !panel) void open().catch(fail); }, 2000);
      return;
    }
    if (error instanceof TypeError && /module/.test(error.message)) { // a chunk of an older page
      say(h('h2', {}, 'The page is not current'), h('p', {}, 'The coordinator serves another version of this page.'),
        h('button', { class: 'button primary', onclick: () => location.reload() }, 'Load it again'));
      return;
    }
    say(h('h2', {}, 'The result cannot be shown'), h('p', { class: 'reason' }, error instanceof Error ? error.message : String(error)),
      h('a', { class: 'button', href: address(name) }, 'To the job'));
  }

  void open().catch(fail);
  const view: View = {
    title: name, element,
    follow(next) {
      return next.parts[0] === 'jobs' && `jobs/${next.parts[1]}` === name && next.parts[2] === 'result' && currentRoute().query.has('camera') && panel !== null;
    },
    close() {
      closed = true;
      follower?.stop();
      panel?.close();
    },
  };
  Object.defineProperty(view, 'title', { get: () => `Result of ${job ? jobTitle(job) : name}` });
  return view;
}

