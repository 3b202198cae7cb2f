// The map of a job's tiles on the ground, north up, with the cameras of the selected tile.
import type { Tile, View } from '../api/types';
import { h, renderInto, svg } from '../base/dom';
import { fillOf, kLayers, kTileStates, kUnknownFill, type Layer, scaleOf, tileState, viridis } from './tile_layers';

interface Box { x: number; y: number; width: number; height: number }
interface Shape { group: SVGGElement; path: SVGPathElement; mark: SVGTextElement; x: number; y: number; side: number }

const kMaxMarked = 400, kMargin = 0.06;

export class TileMap {
  readonly element = h('div', { class: 'map' });
  private readonly drawing = svg('svg', {
    class: 'tiles', role: 'group', 'aria-label': 'Tiles on the ground, north up. Arrow keys go to the next tile.',
  });
  private readonly shapesGroup = svg('g');
  private readonly cameraGroup = svg('g', { class: 'cameras' });
  private readonly bar = h('div', { class: 'mapbar' });
  private readonly legend = h('div', { class: 'legend' });
  private readonly shapes = new Map<number, Shape>();
  private tiles: Tile[] = [];
  private views: View[] = [];
  private layer: Layer = kLayers[0];
  private selected = -1;
  private extent: Box = { x: 0, y: 0, width: 1, height: 1 };
  private box: Box = this.extent;
  private moved = false; // by the user: then a selection leaves the view as it is

  // `onSelect`: a tile was chosen; -1: none.
  constructor(private readonly onSelect: (tile: number) => void) {
    this.drawing.append(this.shapesGroup, this.cameraGroup);
    this.element.append(this.bar, this.drawing, this.legend);
    this.drawing.addEventListener('wheel', (event) => {
      if (!event.ctrlKey && !event.metaKey && document.activeElement?.closest('.map') !== this.element) return;
      event.preventDefault();
      this.zoom(Math.exp(event.deltaY * 0.0015), event.clientX, event.clientY);
    }, { passive: false });
    this.drag();
    this.drawing.addEventListener('keydown', (event) => this.onKey(event));
    this.renderBar();
  }

  setTiles(tiles: Tile[]): void {
    const known = this.tiles.length;
    this.tiles = tiles;
    if (tiles.length !== known || known !== this.shapes.size) this.build();
    this.paint();
  }

  setViews(views: View[]): void {
    this.views = views;
    this.drawCameras();
    if (!this.moved) this.fit();
  }

  select(tile: number): void {
    this.selected = tile;
    this.paint();
    if (!this.moved) this.fit();
  }

  private build(): void {
    this.shapes.clear();
    let x0 = Infinity, y0 = Infinity, x1 = -Infinity, y1 = -Infinity;
    const groups = this.tiles.filter((tile) => tile.core.length > 0).map((tile) => {
      let area = 0, x = 0, y = 0;
      const parts = tile.core.map((r) => {
        x0 = Math.min(x0, r.x0M);
        x1 = Math.max(x1, r.x1M);
        y0 = Math.min(y0, -r.y1M);
        y1 = Math.max(y1, -r.y0M);
        const a = (r.x1M - r.x0M) * (r.y1M - r.y0M);
        if (a > area) [area, x, y] = [a, (r.x0M + r.x1M) / 2, -(r.y0M + r.y1M) / 2];
        return `M${r.x0M} ${-r.y0M}H${r.x1M}V${-r.y1M}H${r.x0M}z`;
      });
      const path = svg('path', { d: parts.join('') });
      const mark = svg('text', { x, y, 'aria-hidden': 'true' });
      const group = svg('g', {
        class: 'tile', role: 'button', tabindex: -1,
        onclick: () => this.onSelect(this.selected === tile.tile ? -1 : tile.tile),
      }, path, mark);
      this.shapes.set(tile.tile, { group, path, mark, x, y, side: Math.sqrt(area) });
      return group;
    });
    this.shapesGroup.replaceChildren(...groups);
    if (!(x1 > x0)) return;
    const margin = kMargin * Math.max(x1 - x0, y1 - y0);
    this.extent = { x: x0 - margin, y: y0 - margin, width: x1 - x0 + 2 * margin, height: y1 - y0 + 2 * margin };
    this.drawing.style.aspectRatio = String(Math.min(Math.max(this.extent.width / this.extent.height, 0.6), 3));
    this.show(this.extent);
  }

  private paint(): void {
    const scale = this.layer.value ? scaleOf(this.layer, this.tiles) : null;
    const selectedTile = this.tiles.find((tile) => tile.tile === this.selected);
    const waitsFor = new Set(selectedTile?.waitsFor ?? []);
    const marked = this.tiles.length <= kMaxMarked;
    let first = true;
    for (const tile of this.tiles) {
      const shape = this.shapes.get(tile.tile);
      if (!shape) continue;
      const state = tileState(tile), value = this.layer.value?.(tile);
      shape.path.style.fill = fillOf(this.layer, scale, tile);
      const text = marked ? `${tile.tile}${state.mark && ` ${state.mark}`}` : '';
      if (shape.mark.textContent !== text) shape.mark.textContent = text;
      const isSelected = tile.tile === this.selected;
      shape.group.setAttribute('class', `tile${isSelected ? ' selected' : ''}${waitsFor.has(tile.tile) ? ' waited' : ''}`);
      shape.group.setAttribute('aria-pressed', String(isSelected));
      shape.group.setAttribute('tabindex', (selectedTile ? isSelected : first) ? '0' : '-1');
      first = false;
      const figure = value === undefined ? '' : `, ${this.layer.name.toLowerCase()} ${value < 0 ? 'not known' : this.layer.text!(value)}`;
      shape.group.setAttribute('aria-label', `Tile ${tile.tile}, ${state.name}${figure}`);
      if (isSelected && shape.group.nextSibling) this.raise(shape.group);
    }
    this.renderLegend(scale);
    this.drawCameras();
  }

  // Draws the selected tile last, so that its outline is seen; keeps the focus, which a move would take away.
  private raise(group: SVGGElement): void {
    const focused = document.activeElement === group;
    this.shapesGroup.append(group);
    if (focused) group.focus({ preventScroll: true });
  }

  private drawCameras(): void {
    const tile = this.tiles.find((each) => each.tile === this.selected);
    const radius = Math.max(this.box.width, this.box.height) * 0.008;
    this.cameraGroup.replaceChildren(...(tile?.views ?? []).flatMap((index) => {
      const view = this.views[index];
      if (!view) return [];
      const x = view.groundXM, y = -view.groundYM, length = 4 * radius;
      return [svg('g', {}, svg('title', {}, view.image),
        svg('line', { x1: x, y1: y, x2: x + length * view.groundDirectionX, y2: y - length * view.groundDirectionY, 'stroke-width': radius * 0.5 }),
        svg('circle', { cx: x, cy: y, r: radius }))];
    }));
  }

  private renderBar(): void {
    renderInto(this.bar,
      h('label', {}, 'Colour by ', h('select', {
        value: this.layer.id,
        onchange: (event: Event) => {
          this.layer = kLayers.find((layer) => layer.id === (event.target as HTMLSelectElement).value) ?? kLayers[0];
          this.paint();
        },
      }, kLayers.map((layer) => h('option', { value: layer.id }, layer.name)))),
      h('span', { class: 'buttons' },
        h('button', { class: 'button small', 'aria-label': 'Zoom in', onclick: () => this.zoom(0.7) }, '+'),
        h('button', { class: 'button small', 'aria-label': 'Zoom out', onclick: () => this.zoom(1 / 0.7) }, '−'),
        h('button', { class: 'button small', onclick: () => this.fit() }, 'Fit')));
  }

  private renderLegend(scale: { low: number; high: number } | null): void {
    if (!this.layer.value) {
      const count = new Map<string, number>();
      for (const tile of this.tiles) count.set(tile.state, (count.get(tile.state) ?? 0) + 1);
      renderInto(this.legend, kTileStates.filter((state) => count.has(state.id)).map((state) => h('span', { class: 'entry' },
        h('i', { style: { background: state.color } }), `${state.name} ${state.mark && `${state.mark} `}(${count.get(state.id)})`)));
      return;
    }
    const text = this.layer.text!;
    renderInto(this.legend,
      scale ? h('span', { class: 'entry' }, text(scale.low),
        h('i', { class: 'ramp', style: { background: `linear-gradient(90deg, ${[0, 0.25, 0.5, 0.75, 1].map(viridis).join(',')})` } }),
        text(scale.high)) : h('span', { class: 'entry' }, 'not known for any tile yet'),
      scale && h('span', { class: 'entry' }, h('i', { style: { background: kUnknownFill } }), 'not known'));
  }

  private show(box: Box): void {
    this.box = box;
    this.drawing.setAttribute('viewBox', `${box.x} ${box.y} ${box.width} ${box.height}`);
    // Signs fit their tiles and are no larger than a twentieth of the map.
    const largest = 0.05 * Math.max(box.width, box.height);
    if (this.shapes.size <= kMaxMarked) {
      for (const { mark, side } of this.shapes.values()) mark.setAttribute('font-size', String(Math.min(0.3 * side, largest)));
    }
    this.drawCameras();
  }

  // The tiles, and the cameras of the selected one.
  private fit(): void {
    const tile = this.tiles.find((each) => each.tile === this.selected);
    let { x, y, width, height } = this.extent;
    for (const index of tile?.views ?? []) {
      const view = this.views[index];
      if (!view) continue;
      const margin = 0.03 * Math.max(this.extent.width, this.extent.height), { groundXM, groundYM } = view;
      const right = Math.max(x + width, groundXM + margin), bottom = Math.max(y + height, -groundYM + margin);
      x = Math.min(x, groundXM - margin);
      y = Math.min(y, -groundYM - margin);
      [width, height] = [right - x, bottom - y];
    }
    this.moved = false;
    this.show({ x, y, width, height });
  }

  private zoom(factor: number, clientX?: number, clientY?: number): void {
    this.moved = true;
    const { x, y, width, height } = this.box;
    let at = { x: x + width / 2, y: y + height / 2 };
    const matrix = this.drawing.getScreenCTM();
    if (clientX !== undefined && clientY !== undefined && matrix) {
      at = new DOMPoint(clientX, clientY).matrixTransform(matrix.inverse());
    }
    const scale = Math.min(Math.max(factor, (0.02 * this.extent.width) / width), (4 * this.extent.width) / width);
    this.show({ x: at.x + (x - at.x) * scale, y: at.y + (y - at.y) * scale, width: width * scale, height: height * scale });
  }

  private drag(): void {
    let from: { x: number; y: number; box: Box } | null = null, moved = false;
    this.drawing.addEventListener('pointerdown', (event) => {
      if (event.button === 0 && event.pointerType !== 'touch') from = { x: event.clientX, y: event.clientY, box: this.box };
      moved = false;
    });
    this.drawing.addEventListener('pointermove', (event) => {
      if (!from || (event.buttons & 1) === 0) return;
      const matrix = this.drawing.getScreenCTM();
      const dx = event.clientX - from.x, dy = event.clientY - from.y;
      if (!matrix || (!moved && Math.hypot(dx, dy) < 5)) return;
      moved = this.moved = true;
      this.show({ ...from.box, x: from.box.x - dx / matrix.a, y: from.box.y - dy / matrix.d });
    });
    window.addEventListener('pointerup', () => { from = null; });
    // A drag is no click.
    this.drawing.addEventListener('click', (event) => { if (moved) event.stopPropagation(); }, { capture: true });
  }

  private onKey(event: KeyboardEvent): void {
    const group = (event.target as Element).closest('g.tile');
    const current = [...this.shapes].find(([, shape]) => shape.group === group);
    if (!current) return;
    if (event.key === 'Enter' || event.key === ' ') {
      event.preventDefault();
      this.onSelect(this.selected === current[0] ? -1 : current[0]);
    }
    const direction = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] }[event.key];
    if (!direction) return;
    event.preventDefault();
    // The nearest tile whose centre lies in that direction; what lies aside counts twice.
    let best: Shape | null = null, least = Infinity;
    for (const shape of this.shapes.values()) {
      const dx = shape.x - current[1].x, dy = shape.y - current[1].y;
      const along = dx * direction[0] + dy * direction[1], aside = Math.abs(dx * direction[1]) + Math.abs(dy * direction[0]);
      if (along <= 0 || aside > 2 * along || along + 2 * aside >= least) continue;
      [best, least] = [shape, along + 2 * aside];
    }
    if (!best) return;
    group!.setAttribute('tabindex', '-1');
    best.group.setAttribute('tabindex', '0');
    best.group.focus();
  }
}
