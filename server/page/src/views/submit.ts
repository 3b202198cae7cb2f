// Submit a job: scene, settings with their ranges, the quote, the start.
import { change, get, requestId } from '../api/client';
import type { Interval, Job, Quote, Setting, Settings } from '../api/types';
import { notifyError } from '../base/dialog';
import { h, renderInto } from '../base/dom';
import { bytes, coreTime, number, thousands } from '../base/format';
import { address, type Route } from '../router';
import type { View } from './view';

const kFirst = ['tiles', 'rounds', 'tile_memory', 'tile_memory_gib', 'formats']; // shown before "All settings"

// Units that people type: values of a setting are multiples of `scale`.
function shownUnit(setting: Setting): { name: string; scale: number } {
  if (setting.unit === 'bytes') return { name: 'GiB', scale: 2 ** 30 };
  if (setting.unit === 'core-seconds') return { name: 'core\u2011hours', scale: 3600 };
  return { name: setting.unit, scale: 1 };
}

function range(setting: Setting): string {
  const { name, scale } = shownUnit(setting), unit = name ? `\u00a0${name}` : '';
  if (setting.minimum === undefined && setting.maximum === undefined) return name;
  if (setting.maximum === undefined) return `at least ${number(setting.minimum! / scale, 6)}${unit}`;
  return `${number((setting.minimum ?? 0) / scale, 6)} to ${number(setting.maximum / scale, 6)}${unit}`;
}

function words(name: string): string {
  return name.replaceAll('_', ' ').replace(/\b(crs|gsd)\b/g, (word) => word.toUpperCase());
}

// The value of a field as JSON; undefined: not set.
function parse(setting: Setting, text: string): unknown {
  if (text === '') return undefined;
  switch (setting.kind) {
    case 'SETTING_KIND_NUMBER': case 'SETTING_KIND_INTEGER':
      return shownUnit(setting).scale === 1 ? Number(text) : Math.round(Number(text) * shownUnit(setting).scale);
    case 'SETTING_KIND_BOOLEAN':
      return text === 'true';
    case 'SETTING_KIND_LIST':
      return text.split(/[\s,]+/).filter(Boolean).map(Number);
    default:
      return text;
  }
}

function put(target: Record<string, any>, path: string, value: unknown): void {
  const parts = path.split('.');
  const last = parts.pop()!;
  for (const part of parts) target = target[part] ??= {};
  target[last] = value;
}

export function submitView(_route: Route): View {
  const body = h('div');
  const element = h('div', { class: 'page narrow' }, body);
  let settings: Settings | null = null, quote: Quote | null = null, fault = '', busy = false, request = requestId();
  let scene = '', title = '', method = '', priority = '0', all = false;
  const values = new Map<string, string>(), formats = new Set<string>();

  void get<Settings>('/api/v1/settings').then((found) => {
    settings = found;
    method = found.methods[0]?.name ?? 'tessera';
    render();
  }, (error) => {
    fault = String(error.message);
    render();
  });

  // A change of the request makes its quote void.
  function changed(): void {
    quote = null;
    fault = '';
    request = requestId();
    render();
  }

  function createRequest(): unknown {
    const chosen: Record<string, any> = { method };
    for (const setting of settings?.settings ?? []) {
      const text = values.get(setting.name);
      if (text === undefined || !applies(setting)) continue;
      const value = parse(setting, text);
      if (value !== undefined) put(chosen, setting.field, value);
    }
    if (formats.size > 0) put(chosen, 'export.formats', [...formats]);
    return { requestId: request, scenePath: scene, displayName: title, priority: Number(priority) || 0, settings: chosen };
  }

  // A setting that some methods have a default for applies to those alone.
  function applies(setting: Setting): boolean {
    const known = Object.keys(setting.defaults ?? {});
    return known.length === 0 || known.includes(method);
  }

  async function send<T>(path: string, done: (value: T) => void): Promise<void> {
    busy = true;
    fault = '';
    render();
    try {
      done(await change<T>('POST', path, createRequest()));
    } catch (error) {
      fault = error instanceof Error ? error.message : String(error);
      if (!(error instanceof Error)) notifyError(error);
    } finally {
      busy = false;
      render();
    }
  }

  function field(setting: Setting): HTMLElement {
    const id = `setting-${setting.name}`, value = values.get(setting.name) ?? '', standard = (setting.defaults?.[method] ?? '').replace(/^true$/, 'yes').replace(/^false$/, 'no');
    const set = (event: Event) => {
      values.set(setting.name, (event.target as HTMLInputElement).value);
      changed();
    };
    const common = { id, 'aria-describedby': `${id}-help`, onchange: set };
    const choice = (choices: [string, string][]) => h('select', { ...common, value },
      h('option', { value: '' }, standard ? `default (${standard})` : 'default'), choices.map(([v, text]) => h('option', { value: v }, text)));
    let input: HTMLElement;
    const { scale } = shownUnit(setting), scaled = (limit: number | undefined) => (limit === undefined ? null : limit / scale);
    if (setting.kind === 'SETTING_KIND_BOOLEAN') input = choice([['true', 'yes'], ['false', 'no']]);
    else if (setting.kind === 'SETTING_KIND_CHOICE') input = choice(setting.choices.map((c) => [c, c]));
    else if (setting.kind === 'SETTING_KIND_NUMBER' || setting.kind === 'SETTING_KIND_INTEGER') {
      input = h('input', {
        ...common, type: 'number', value, placeholder: standard && Number.isFinite(Number(standard)) ? number(Number(standard) / scale, 6) : standard,
        min: scaled(setting.minimum), max: scaled(setting.maximum), step: setting.kind === 'SETTING_KIND_INTEGER' && scale === 1 ? 1 : 'any',
      });
    } else input = h('input', { ...common, type: 'text', value, placeholder: standard, spellcheck: 'false' });
    const limits = range(setting);
    return h('div', { class: 'field', 'data-key': setting.name }, h('label', { for: id }, words(setting.name), scale !== 1 && ` (${shownUnit(setting).name})`), input,
      h('div', { id: `${id}-help`, class: 'soft' }, setting.help, limits && ` (${limits})`));
  }

  function formatBoxes(): HTMLElement {
    return h('fieldset', {}, h('legend', {}, 'Export formats'), (settings?.formats ?? []).map((format) => h('label', { class: 'box', 'data-key': format.name },
      h('input', {
        type: 'checkbox', checked: formats.has(format.name),
        onchange: (event: Event) => {
          if ((event.target as HTMLInputElement).checked) formats.add(format.name);
          else formats.delete(format.name);
          changed();
        },
      }), h('span', {}, h('b', {}, format.name), ` ${format.help}`))));
  }

  function quoteCard(now: Quote): HTMLElement {
    const between = (interval: Interval | undefined, text: (value: number) => string) => {
      if (!interval || (interval.high <= 0 && interval.low <= 0)) return 'not known';
      const low = text(interval.low), high = text(interval.high);
      const unit = /\u00a0.*$/;
      if (low === high) return high;
      return unit.exec(low)?.[0] === unit.exec(high)?.[0] ? `${low.replace(unit, '')} to ${high}` : `${low} to ${high}`;
    };
    const figure = (name: string, value: string, field_ = '') => h('div', { class: 'figure' }, h('dt', {}, name), h('dd', {}, value),
      now.estimated.includes(field_) && h('dd', { class: 'soft' }, 'an estimate'));
    return h('section', { class: 'card', 'aria-label': 'Quote' }, h('h2', {}, 'Quote'),
      h('dl', { class: 'figures' },
        figure('Cost', between(now.coreSeconds, coreTime), 'core_seconds'), figure('Tiles', between(now.tiles, (v) => String(Math.round(v))), 'tiles'),
        figure('Memory of a worker', between(now.peakBytes, bytes), 'peak_bytes'), figure('Disk', between(now.storedBytes, bytes), 'stored_bytes'),
        figure('Images', thousands(now.images)), figure('Pixels', `${number(now.pixels / 1e6)} million`),
        figure('Area', between(now.areaM2, (v) => `${number(v / 1e6)} km²`), 'area_m2'),
        figure('Ground sampling distance', now.gsdM > 0 ? `${number(now.gsdM)} m` : 'not known', 'gsd_m'),
        Number(now.meshFaces) >= 0 && figure('Faces of the mesh', thousands(Number(now.meshFaces)))),
      now.basis && h('p', { class: 'soft' }, `Computed from: ${now.basis}`),
      now.warnings.length > 0 && h('div', { class: 'note warn' }, h('b', {}, 'Warnings'), h('ul', {}, now.warnings.map((text) => h('li', {}, text)))));
  }

  function render(): void {
    const known = settings?.settings.filter((setting) => applies(setting) && setting.name !== 'method' && setting.kind !== 'SETTING_KIND_CHOICES' &&
      !setting.field.startsWith('export.') && !setting.field.startsWith('update.')) ?? [];
    const exportFields = settings?.settings.filter((setting) => setting.field.startsWith('export.') && setting.kind !== 'SETTING_KIND_CHOICES') ?? [];
    const first = known.filter((setting) => kFirst.includes(setting.name)), rest = known.filter((setting) => !kFirst.includes(setting.name));
    const text = (id: string, label: string, help: string, value: string, set: (v: string) => void, required = false) => h('div', { class: 'field', 'data-key': id },
      h('label', { for: id }, label), h('input', {
        id, value, required, 'aria-describedby': `${id}-help`, spellcheck: 'false', autocomplete: 'off',
        onchange: (event: Event) => { set((event.target as HTMLInputElement).value.trim()); changed(); },
      }), h('div', { id: `${id}-help`, class: 'soft' }, help));
    renderInto(body,
      h('p', { class: 'crumbs' }, h('a', { href: address('jobs') }, 'Jobs'), ' / submit'),
      h('h1', {}, 'Submit a job'),
      h('form', {
        class: 'submit',
        onsubmit: (event: SubmitEvent) => {
          event.preventDefault();
          (document.activeElement as HTMLElement | null)?.blur(); // takes over what was just typed
          if (busy) return;
          if (quote) void send<Job>('/api/v1/jobs', (job) => { location.hash = address(job.name); });
          else void send<Quote>('/api/v1/quote', (found) => { quote = found; });
        },
      },
      h('section', { class: 'card' }, h('h2', {}, 'Scene'),
        text('scene', 'Path of the scene', 'A folder below the scene roots of the coordinator, or s3://BUCKET/PREFIX.', scene, (v) => { scene = v; }, true),
        text('title', 'Name of the job', 'Shown in the list of jobs.', title, (v) => { title = v; }),
        h('div', { class: 'field' }, h('label', { for: 'priority' }, 'Priority'), h('input', {
          id: 'priority', type: 'number', min: -100, max: 100, step: 1, value: priority, 'aria-describedby': 'priority-help',
          onchange: (event: Event) => { priority = (event.target as HTMLInputElement).value; changed(); },
        }), h('div', { id: 'priority-help', class: 'soft' }, 'Free workers take tasks of the highest priority first (−100 to 100).'))),
      settings && h('section', { class: 'card' }, h('h2', {}, 'Settings'),
        h('div', { class: 'field' }, h('label', { for: 'method' }, 'Method'), h('select', {
          id: 'method', value: method, 'aria-describedby': 'method-help',
          onchange: (event: Event) => { method = (event.target as HTMLSelectElement).value; changed(); },
        }, settings.methods.map((choice) => h('option', { value: choice.name }, choice.name))),
        h('div', { id: 'method-help', class: 'soft' }, settings.methods.find((choice) => choice.name === method)?.help)),
        first.map(field), formatBoxes(), formats.size > 0 && exportFields.map(field),
        h('details', { ontoggle: (event: Event) => { all = (event.target as HTMLDetailsElement).open; render(); } },
          h('summary', {}, `All settings (${rest.length})`), all && h('div', { class: 'grid' }, rest.map(field)))),
      fault && h('div', { class: 'note bad', role: 'alert' }, h('b', {}, 'The coordinator refused this: '), h('div', { class: 'reason' }, fault)),
      quote && quoteCard(quote),
      h('div', { class: 'buttons' },
        h('button', { type: 'submit', class: 'button primary', disabled: busy }, busy ? 'Please wait' : quote ? 'Start the job' : 'Get a quote'),
        quote && h('span', { class: 'soft' }, 'Nothing has started yet.'))));
  }
  render();
  return { title: 'Submit a job', element, follow: (next) => next.parts[0] === 'submit', close() {} };
}
