// The 3D view with its panel: divider, classes, colours, what lies under a click, distances, cameras of a tile.
import { get, getAll } from '../api/client';
import type { Job, Located, Tile, View as Camera } from '../api/types';
import { notify } from '../base/dialog';
import { h, renderInto } from '../base/dom';
import { bytes, number, percent, thousands } from '../base/format';
import { address, currentRoute, replaceQuery } from '../router';
import type { Vec } from './fit';
import { meshOf, nearestFace, readMesh } from './input_face';
import { type ColorMode, cssColor, kColorModes, type SurfaceClass } from './surface_material';
import type { Attributes } from './tile_set';
import { type Hit, type TileSetAddress, Viewer } from './viewer';

// Of report.json.
export interface Report { gsd_m?: number }

export interface ResultFacts {
  job: Job;
  result: TileSetAddress;
  start: TileSetAddress | null;
  report: Promise<Report>;
  fileColor: string; // what the colours in the files are: class, image, confidence, displacement
}

const kModeNames: Record<ColorMode, string> = { class: 'Class', file: 'Image', confidence: 'Confidence', displacement: 'Displacement' };

// Angles have more decimals than metres.
function coordinates({ onGlobe, crs, x, y, z }: Located): string {
  const degrees = onGlobe && !/^ENU|east-north-up/.test(crs) && Math.abs(x) <= 360 && Math.abs(y) <= 90;
  return `${x.toFixed(degrees ? 8 : 2)}, ${y.toFixed(degrees ? 8 : 2)}, ${z.toFixed(2)}`;
}

export class ResultPanel {
  readonly element = h('div', { class: 'result' });
  private readonly holder = h('div', { class: 'holder' });
  private readonly panel = h('aside', { class: 'panel', 'aria-label': 'Settings of the view' });
  private readonly divider = h('div', { class: 'divider', 'aria-hidden': 'true' }, h('span', {}, '⇔'));
  private readonly sideNames = [h('span', { class: 'side left' }, 'Start'), h('span', { class: 'side right' }, 'Result')];
  private readonly slider = h('input', { type: 'range', min: 0, max: 100, step: 1, 'aria-label': 'Start and result: share of the view that shows the start' });
  private readonly status = h('p', { class: 'status', role: 'status' }, 'Loading the result');
  private readonly viewer: Viewer;
  private gsd_m = 0; // 0: not known yet
  private classes: SurfaceClass[] = [];
  private has: Attributes = { confidence: false, displacement: false, color: false };
  private mode: ColorMode = 'class';
  private hidden = false; // the address's classes have been hidden
  private hit: Hit | null = null;
  private located: Located | string = ''; // of `hit`; or why it is not known
  private inputFace = ''; // of `hit`, or why it is not known; empty: not asked for
  private mesh: Promise<ArrayBuffer> | null = null;
  private measuring = false;
  private line: Vec[] = [];
  private tiles: Tile[] = [];
  private cameras: Camera[] = [];
  private cameraTile = -1;
  private camerasNote = '';
  private timer: ReturnType<typeof setTimeout> | undefined;

  // Throws if the browser has no WebGL 2.
  constructor(private readonly facts: ResultFacts) {
    this.element.append(this.holder, this.panel);
    const query = currentRoute().query;
    this.viewer = new Viewer(this.holder, facts.result, facts.start, this.cameraOf(query.get('camera')));
    this.holder.append(...(facts.start ? [this.divider, ...this.sideNames,
      h('div', { class: 'wipe' }, h('span', { 'aria-hidden': 'true' }, 'Result'), this.slider, h('span', { 'aria-hidden': 'true' }, 'Start'))] : []), this.status,
    h('span', { class: 'cross', 'aria-hidden': 'true' }));
    this.viewer.onClasses = (classes, has) => this.setClasses(classes, has);
    this.viewer.onFrame = (triangles, loading) => {
      this.status.textContent = `${loading ? 'Loading · ' : ''}${thousands(triangles)} triangles in view`;
      this.element.dataset['triangles'] = String(triangles);
      this.element.dataset['loading'] = String(loading || triangles === 0);
    };
    this.viewer.onFault = (text) => notify(text, true);
    this.viewer.onMove = () => this.saveCamera();
    const wipe = Number(query.get('wipe') ?? (facts.start ? 50 : 0));
    this.setWipe(Number.isFinite(wipe) ? wipe / 100 : 0);
    const mode = query.get('color') as ColorMode;
    if (kColorModes.includes(mode)) this.mode = mode;
    this.viewer.setMode(this.mode);
    this.listen();
    this.render();
    void facts.report.then(({ gsd_m }) => {
      this.gsd_m = gsd_m ?? 0;
      this.viewer.look.setLargestDisplacement(this.largest_m);
      this.viewer.invalidate();
      this.render();
    });
    void this.loadTiles(Number(query.get('tile') ?? -1));
  }

  close(): void {
    clearTimeout(this.timer);
    this.viewer.close();
  }

  // Displacement with the last colour, as in exported files.
  private get largest_m(): number {
    return this.gsd_m > 0 ? 10 * this.gsd_m : 1;
  }

  private cameraOf(text: string | null): Vec[] | null {
    const values = (text ?? '').split(',').map(Number);
    if (values.length !== 6 || !values.every(Number.isFinite)) return null;
    return [values.slice(0, 3) as Vec, values.slice(3) as Vec];
  }

  private saveCamera(): void {
    clearTimeout(this.timer);
    this.timer = setTimeout(() => replaceQuery({ camera: this.viewer.cameraNow().flat().map((x) => x.toFixed(1)).join(',') }), 300);
  }

  private setWipe(share: number): void {
    this.viewer.setWipe(share);
    const { wipe } = this.viewer;
    this.slider.value = String(Math.round(100 * wipe));
    this.divider.style.left = `${100 * wipe}%`;
    this.divider.hidden = wipe <= 0 || wipe >= 1;
    this.sideNames[0].hidden = wipe <= 0.05;
    this.sideNames[1].hidden = wipe >= 0.95;
  }

  private setClasses(classes: SurfaceClass[], has: Attributes): void {
    [this.classes, this.has] = [classes, has];
    if (this.hidden) return this.render();
    this.hidden = true;
    const hidden = (currentRoute().query.get('hide') ?? '').split(',').filter(Boolean).map(Number);
    for (const index of hidden) this.viewer.look.setVisible(index, false);
    this.render();
  }

  private listen(): void {
    this.slider.oninput = () => {
      this.setWipe(Number(this.slider.value) / 100);
      replaceQuery({ wipe: this.slider.value });
    };
    this.divider.onpointerdown = (event) => {
      this.divider.setPointerCapture(event.pointerId);
      event.preventDefault();
    };
    this.divider.onpointermove = (event) => {
      if (!this.divider.hasPointerCapture(event.pointerId)) return;
      const box = this.holder.getBoundingClientRect();
      this.setWipe((event.clientX - box.left) / box.width);
      replaceQuery({ wipe: this.slider.value });
    };
    const { canvas } = this.viewer;
    let down: PointerEvent | null = null;
    canvas.addEventListener('pointerdown', (event) => { down = event; });
    canvas.addEventListener('pointerup', (event) => {
      if (down && event.button === 0 && Math.hypot(event.clientX - down.clientX, event.clientY - down.clientY) < 5) this.choose(event.clientX, event.clientY);
      down = null;
    });
    canvas.addEventListener('keydown', (event) => this.onKey(event));
  }

  private onKey(event: KeyboardEvent): void {
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    const box = this.viewer.canvas.getBoundingClientRect(), v = this.viewer;
    const keys: Record<string, () => void> = {
      ArrowLeft: () => v.move(-0.1, 0), ArrowRight: () => v.move(0.1, 0), ArrowUp: () => v.move(0, 0.1), ArrowDown: () => v.move(0, -0.1),
      q: () => v.orbit(-0.15, 0, 1), e: () => v.orbit(0.15, 0, 1), r: () => v.orbit(0, -0.1, 1), f: () => v.orbit(0, 0.1, 1),
      '+': () => v.orbit(0, 0, 0.85), '=': () => v.orbit(0, 0, 0.85), '-': () => v.orbit(0, 0, 1 / 0.85), Home: () => v.showAll(),
      Enter: () => this.choose(box.left + box.width / 2, box.top + box.height / 2),
      m: () => this.setMeasuring(!this.measuring), Escape: () => { this.hit = null; this.setMeasuring(false); },
    };
    const action = keys[event.key.length === 1 ? event.key.toLowerCase() : event.key];
    if (!action) return;
    event.preventDefault();
    action();
  }

  private choose(clientX: number, clientY: number): void {
    const hit = this.viewer.pick(clientX, clientY);
    if (this.measuring) {
      if (hit) this.line.push(hit.enu);
      this.viewer.setLine(this.line);
    } else {
      this.hit = hit;
      this.inputFace = this.mesh ? 'searching' : '';
      if (hit) void this.locateHit(hit);
    }
    this.placeMarks();
    this.render();
  }

  private setMeasuring(on: boolean): void {
    this.measuring = on;
    this.line = [];
    this.viewer.setLine([]);
    this.placeMarks();
    this.render();
  }

  private placeMarks(): void {
    for (const { element } of this.viewer.marks) element.remove();
    const points = this.measuring ? this.line : this.hit ? [this.hit.enu] : [];
    this.viewer.marks.splice(0, Infinity, ...points.map((enu) => ({ enu, element: h('span', { class: 'mark', 'aria-hidden': 'true' }) })));
    this.holder.append(...this.viewer.marks.map(({ element }) => element));
    this.viewer.invalidate();
  }

  private async loadTiles(tile: number): Promise<void> {
    const { job } = this.facts;
    try {
      this.tiles = (await getAll<Tile>(`/api/v1/${job.name}/tiles`, 'tiles', 100_000)).items;
    } catch {
      return; // Without them, a click names no tile.
    }
    this.render();
    if (tile >= 0) await this.showCameras(tile, currentRoute().query.get('camera') === null);
  }

  // Where a point of the drawing is.
  private locate([xM, yM, zM]: Vec): Promise<Located> {
    const query = new URLSearchParams({ xM: xM.toFixed(4), yM: yM.toFixed(4), zM: zM.toFixed(4) });
    return get<Located>(`/api/v1/${this.facts.job.name}:locate?${query}`);
  }

  // Reads mesh.ply once, which is as large as the result.
  private async findInputFace(hit: Hit, at: Located): Promise<void> {
    const job = this.facts.job.name;
    const say = (text: string) => {
      if (this.hit !== hit) return;
      this.inputFace = text;
      this.render();
    };
    try {
      if (!this.mesh) {
        const size = (await meshOf(job)).digest.sizeBytes;
        say(`reading mesh.ply (${bytes(size)})`);
        this.mesh = readMesh(job);
        this.mesh.catch(() => { this.mesh = null; });
      }
      const { inputFace, distance_m } = nearestFace(await this.mesh, [at.sceneXM, at.sceneYM, at.sceneZM]);
      say(`${thousands(inputFace)}${distance_m > 0.05 ? `, of the nearest face at ${distance_m.toFixed(2)} m` : ''}`);
    } catch (error) {
      say(error instanceof Error ? error.message : String(error));
    }
  }

  private async locateHit(hit: Hit): Promise<void> {
    this.located = 'Asking for the coordinates';
    let found: Located | string;
    try {
      found = await this.locate(hit.enu);
    } catch (error) {
      found = error instanceof Error ? error.message : String(error);
    }
    if (this.hit !== hit) return;
    this.located = found;
    this.render();
    if (this.mesh && typeof found !== 'string' && hit.side === 'result') void this.findInputFace(hit, found);
  }

  private async showCameras(tile: number, move: boolean): Promise<void> {
    this.cameraTile = tile;
    replaceQuery({ tile: tile >= 0 ? String(tile) : undefined });
    const chosen = this.tiles.find((each) => each.tile === tile);
    this.camerasNote = '';
    if (chosen && this.cameras.length === 0) {
      try {
        this.cameras = (await getAll<Camera>(`/api/v1/${this.facts.job.name}/views`, 'views', 200_000)).items;
      } catch (error) {
        this.camerasNote = error instanceof Error ? error.message : String(error);
      }
    }
    const shown = (chosen?.views ?? []).flatMap((index) => {
      const camera = this.cameras[index];
      if (!camera || Math.hypot(camera.tilesDirectionX, camera.tilesDirectionY, camera.tilesDirectionZ) === 0) return [];
      return [{ centre: [camera.tilesXM, camera.tilesYM, camera.tilesZM] as Vec, direction: [camera.tilesDirectionX, camera.tilesDirectionY, camera.tilesDirectionZ] as Vec }];
    });
    if (chosen && !this.camerasNote) {
      this.camerasNote = shown.length > 0 ? `${shown.length} cameras are drawn in red.` : 'The places of its cameras are not known.';
    }
    const core = chosen?.core[0];
    const size = core ? Math.hypot(core.x1M - core.x0M, core.y1M - core.y0M) : 100;
    this.viewer.setCameras(shown, 0.12 * size);
    if (move) await this.viewer.ready;
    const origin = move && core ? await this.locate([0, 0, 0]).catch(() => null) : null;
    if (core && origin) {
      const middle: Vec = [(core.x0M + core.x1M) / 2 - origin.groundXM, (core.y0M + core.y1M) / 2 - origin.groundYM, this.viewer.height_m];
      // So far away that the cameras are in view, too.
      const farthest = Math.max(0, ...shown.map(({ centre }) => Math.hypot(centre[0] - middle[0], centre[1] - middle[1], centre[2] - middle[2])));
      this.viewer.show(middle, Math.max(0.7 * size, Math.min(1.1 * farthest, 6 * size)));
    }
    this.render();
  }

  private hitFacts(hit: Hit): HTMLElement {
    const at = typeof this.located === 'string' ? null : this.located;
    const fact = (name: string, ...value: (string | HTMLElement)[]) => [h('dt', {}, name), h('dd', {}, ...value)];
    return h('dl', { class: 'facts', 'data-key': 'hit' },
      fact('Surface', hit.side),
      fact('Class', this.classes[hit.classIndex]?.name ?? 'not known'),
      hit.confidence !== null && fact('Confidence', percent(hit.confidence)),
      hit.displacement !== null && fact('Displacement', `${hit.displacement.toFixed(3)} m`),
      at && at.tile >= 0 && fact('Tile', h('a', { href: address(this.facts.job.name, { tile: at.tile }) }, `tile ${at.tile}`), ' ',
        h('button', { class: 'link', onclick: () => void this.showCameras(at.tile, false) }, 'its cameras')),
      at && hit.side === 'result' && fact('Input face', this.inputFace || h('button', { class: 'link', onclick: () => void this.findInputFace(hit, at) }, 'find it in mesh.ply')),
      at ? fact(at.crs || 'Local coordinates', coordinates(at)) : fact('Coordinates', String(this.located)),
      at?.onGlobe && fact('WGS 84', `${at.latitudeDeg.toFixed(7)}°, ${at.longitudeDeg.toFixed(7)}°, ${at.heightM.toFixed(2)} m`));
  }

  private measureFacts(): HTMLElement {
    const lengths = this.line.slice(1).map((p, i) => Math.hypot(p[0] - this.line[i][0], p[1] - this.line[i][1], p[2] - this.line[i][2]));
    const total = lengths.reduce((sum, length) => sum + length, 0);
    const [a, b] = [this.line[0], this.line[this.line.length - 1]];
    return h('div', { 'data-key': 'measure', role: 'status' },
      this.line.length < 2 ? h('p', { class: 'soft' }, this.line.length === 0 ? 'Click the first point.' : 'Click the next point.')
        : h('dl', { class: 'facts' },
          h('dt', {}, 'Distance'), h('dd', {}, h('b', {}, `${total.toFixed(2)} m`), lengths.length > 1 && ` along ${lengths.length} parts`),
          h('dt', {}, 'Level'), h('dd', {}, `${Math.hypot(b[0] - a[0], b[1] - a[1]).toFixed(2)} m`),
          h('dt', {}, 'Height'), h('dd', {}, `${(b[2] - a[2]).toFixed(2)} m`)),
      this.line.length > 0 && h('button', { class: 'button small', onclick: () => this.setMeasuring(true) }, 'Begin again'));
  }

  private render(): void {
    const modes = kColorModes.filter((mode) => mode === 'class' || (mode === 'file' ? this.has.color && this.facts.fileColor !== 'class'
      : mode === 'confidence' ? this.has.confidence : this.has.displacement));
    const fileName = this.facts.fileColor === 'image' ? 'Image' : `Colours of the file (${this.facts.fileColor})`;
    renderInto(this.panel,
      h('h2', {}, 'Colour by'),
      h('div', { class: 'choices', role: 'radiogroup', 'aria-label': 'Colour by' }, modes.map((mode) => h('label', { 'data-key': mode },
        h('input', { type: 'radio', name: 'color', checked: mode === this.mode, onchange: () => {
          this.mode = mode;
          this.viewer.setMode(mode);
          replaceQuery({ color: mode });
          this.render();
        } }), mode === 'file' ? fileName : kModeNames[mode]))),
      this.mode === 'confidence' && h('div', { class: 'ramp viridis', 'aria-hidden': 'true' }),
      this.mode === 'confidence' && h('div', { class: 'ends' }, h('span', {}, '0'), h('span', {}, '1')),
      this.mode === 'displacement' && h('div', { class: 'ramp moved', 'aria-hidden': 'true' }),
      this.mode === 'displacement' && h('div', { class: 'ends' }, h('span', {}, '0 m'), h('span', {}, `${number(this.largest_m, 2)} m`)),
      h('h2', {}, 'Classes'),
      h('div', { class: 'choices' }, this.classes.map((each, i) => h('label', { 'data-key': `class ${i}` },
        h('input', { type: 'checkbox', checked: !this.viewer.look.hidden.has(i), onchange: (event: Event) => {
          this.viewer.look.setVisible(i, (event.target as HTMLInputElement).checked);
          this.viewer.invalidate();
          replaceQuery({ hide: [...this.viewer.look.hidden].join(',') });
          this.render();
        } }), h('i', { class: 'swatch', style: { background: cssColor(each.color) } }), each.name))),
      h('h2', {}, this.measuring ? 'Distance' : 'Point'),
      this.measuring ? this.measureFacts() : this.hit ? this.hitFacts(this.hit) : h('p', { class: 'soft' }, 'Click the surface to read it.'),
      h('div', { class: 'buttons' },
        h('button', { class: 'button small', 'aria-pressed': String(this.measuring), onclick: () => this.setMeasuring(!this.measuring) }, 'Measure'),
        h('button', { class: 'button small', onclick: () => this.viewer.showAll() }, 'Show everything'),
        h('button', { class: 'button small', onclick: () => void this.copyAddress() }, 'Copy address')),
      this.tiles.length > 0 && h('div', { class: 'field' }, h('label', { for: 'camera-tile' }, 'Cameras of tile'),
        h('select', { id: 'camera-tile', value: this.cameraTile >= 0 ? String(this.cameraTile) : '', onchange: (event: Event) => {
          const value = (event.target as HTMLSelectElement).value;
          void this.showCameras(value === '' ? -1 : Number(value), true);
        } }, h('option', { value: '' }, 'none'), this.tiles.slice(0, 2000).map((tile) => h('option', { value: String(tile.tile) }, String(tile.tile))))),
      this.camerasNote && h('p', { class: 'soft' }, this.camerasNote),
      h('details', {}, h('summary', {}, 'Keys'), h('p', { class: 'soft' }, 'Arrows move, Q and E turn, R and F tilt, + and − zoom, Home shows everything, Enter reads the middle, M measures, Esc ends. ',
        'Mouse: left button moves, right button turns, wheel zooms.')));
  }

  private async copyAddress(): Promise<void> {
    replaceQuery({ camera: this.viewer.cameraNow().flat().map((x) => x.toFixed(1)).join(',') });
    try {
      await navigator.clipboard.writeText(location.href);
      notify('The address of this view is in the clipboard.');
    } catch {
      notify(`The address of this view: ${location.href}`);
    }
  }
}
