// The published files of a job, and exports of its result.
import { change, fileUrl, requestId } from '../api/client';
import { may } from '../api/session';
import { type Artifact, hasResult, type Job } from '../api/types';
import { h, scrollBox } from '../base/dom';
import { bytes, plural } from '../base/format';

const kAbout: Record<string, string> = {
  'mesh.ply': 'The refined mesh with a label, a colour and a confidence per face',
  'report.html': 'Figures, pictures and plots on one page',
  'report.json': 'Energies, displacements, label changes, warnings',
  'job.json': 'Every task with its attempts, workers, time and memory',
  'changes.json': 'What was built, demolished, grown or felled',
  'changes.geojson': 'The changed areas, for a GIS',
  'changes.png': 'A picture of the changes',
  'update.json': 'Which tiles are redone, and why',
};

export const kTileset = 'export/3dtiles/result/tileset.json', kStartTileset = 'export/3dtiles/start/tileset.json';

// An export of the result of `job` as 3D Tiles, as a job of its own.
export async function exportTiles(job: Job): Promise<Job> {
  return change<Job>('POST', `/api/v1/${job.name}:export`, {
    requestId: requestId(), displayName: `${job.displayName || job.name}: 3D tiles`, export: { formats: ['3dtiles'] },
  });
}

// Whether this job is an export of the result of `base` with tiles, and may be shown or waited for.
export function isTilesExport(job: Job, base: string): boolean {
  return job.settings?.update?.exportOnly === true && job.settings.update.base === base &&
    (job.settings.export?.formats ?? []).includes('3dtiles') && !/FAILED|CANCELLED/.test(job.state);
}

export function canExport(job: Job): boolean {
  return hasResult(job) && may('ExportJob');
}

function fileRow(job: Job, artifact: Artifact, about: string): HTMLElement {
  const name = artifact.name, shown = /\.(html|json|png|txt|geojson|svg)$/.test(name);
  return h('tr', { 'data-key': name },
    h('td', {}, h('a', { href: fileUrl(job.name, name), target: shown ? '_blank' : null, rel: 'noopener', download: shown ? null : '' }, name),
      about && h('div', { class: 'soft' }, about)),
    h('td', { class: 'number' }, bytes(artifact.digest?.sizeBytes)),
    h('td', {}, h('a', { class: 'button small', href: fileUrl(job.name, name), download: '', 'aria-label': `Download ${name}` }, 'Download')));
}

// `all`: null while the list is loaded. `open`: the folders whose files are listed.
export function filesSection(job: Job, all: Artifact[] | null, open: Set<string>, changed: () => void): HTMLElement {
  if (!all) return h('p', { class: 'soft' }, 'Loading the files');
  if (all.length === 0) return h('p', { class: 'soft' }, 'The job has published no files yet.');
  const folders = new Map<string, Artifact[]>();
  for (const artifact of all) {
    const parts = artifact.name.split('/');
    const folder = parts[0] === 'export' ? parts.slice(0, 2).join('/') : parts.length > 1 ? parts[0] : '';
    folders.set(folder, [...(folders.get(folder) ?? []), artifact]);
  }
  const size = (list: Artifact[]) => list.reduce((sum, artifact) => sum + Number(artifact.digest?.sizeBytes ?? 0), 0);
  const kShown = 500;
  const rows = [...folders].sort(([a], [b]) => a.localeCompare(b)).flatMap(([folder, list]) => folder === ''
    ? list.map((artifact) => fileRow(job, artifact, kAbout[artifact.name] ?? ''))
    : [h('tr', { 'data-key': `folder ${folder}` },
      h('td', {}, h('button', {
        class: 'link', 'aria-expanded': String(open.has(folder)),
        onclick: () => {
          if (!open.delete(folder)) open.add(folder);
          changed();
        },
      }, `${open.has(folder) ? '▾' : '▸'} ${folder}/`), h('div', { class: 'soft' }, plural(list.length, 'file'))),
      h('td', { class: 'number' }, bytes(size(list))), h('td')),
    ...(open.has(folder) ? list.slice(0, kShown).map((artifact) => fileRow(job, artifact, '')) : []),
    open.has(folder) && list.length > kShown && h('tr', {}, h('td', { class: 'soft', colspan: 3 }, `and ${list.length - kShown} more: tessera fetch ${job.name}`))]);
  return h('div', {},
    h('p', { class: 'soft' }, 'All files to a folder: ', h('code', {}, `tessera fetch ${job.name} --out FOLDER`)),
    scrollBox('Files', h('table', { class: 'list' },
      h('thead', {}, h('tr', {}, h('th', {}, 'File'), h('th', { class: 'number' }, 'Size'), h('th', {}, h('span', { class: 'unseen' }, 'Download')))),
      h('tbody', {}, rows))));
}
