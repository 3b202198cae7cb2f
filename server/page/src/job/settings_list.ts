// The settings of a job as a table.
import type { Job } from '../api/types';
import { h } from '../base/dom';
import { bytes, coreTime } from '../base/format';

function words(field: string): string {
  return field.replace(/([A-Z])/g, ' $1').toLowerCase();
}

function text(value: unknown): string {
  if (Array.isArray(value)) return value.join(', ');
  if (typeof value === 'boolean') return value ? 'yes' : 'no';
  return String(value);
}

export function settingsTable(job: Job): HTMLElement {
  const settings = job.settings;
  const rows: [string, string][] = [['scene', job.scenePath]];
  if (settings) {
    rows.push(['method', settings.method || 'tessera'],
      ['tiles', settings.tiles > 0 ? String(settings.tiles) : 'as many as the memory needs'],
      ['memory of a tile', Number(settings.tileMemoryBytes) > 0 ? bytes(settings.tileMemoryBytes) : 'default'],
      ['rounds', settings.rounds > 0 ? String(settings.rounds) : 'default of the method']);
    if (settings.classifier) rows.push(['classifier', settings.classifier]);
    if (settings.skipImages > 0) rows.push(['images that may be left out', `${100 * settings.skipImages} %`]);
    if (settings.anyway) rows.push(['accepts images that do not fit', 'yes']);
    if (settings.maxCoreSeconds > 0) rows.push(['largest cost', coreTime(settings.maxCoreSeconds)]);
    for (const [name, value] of Object.entries(settings.methodSettings ?? {})) {
      if (value !== null && !(Array.isArray(value) && value.length === 0)) rows.push([words(name), text(value)]);
    }
    for (const [name, value] of Object.entries(settings.update ?? {})) {
      if (value && !(Array.isArray(value) && value.length === 0)) rows.push([`update: ${words(name)}`, text(value)]);
    }
    for (const [name, value] of Object.entries(settings.export ?? {})) {
      if (value && !(Array.isArray(value) && value.length === 0)) rows.push([`export: ${words(name)}`, text(value)]);
    }
  }
  return h('table', { class: 'list facts-table' }, h('tbody', {}, rows.map(([name, value]) => h('tr', {}, h('th', { scope: 'row' }, name), h('td', {}, value)))));
}
