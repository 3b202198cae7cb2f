// Photo energy by round, from report.json.
import { h, scrollBox, svg } from '../base/dom';
import { number } from '../base/format';

interface Round { photo_energy_start?: number; photo_energy_end?: number }
interface TileReport { tile?: number; rounds?: Round[] }
export interface Report {
  tiles?: TileReport[]; rounds?: Round[]; frame?: unknown; classes?: unknown; warnings?: string[];
  displacement?: Record<string, number>;
}

interface Curve { name: string; values: number[] } // start of the first round, end of each round

function curveOf(name: string, rounds: Round[]): Curve | null {
  const used = rounds.filter((round) => typeof round.photo_energy_end === 'number');
  if (used.length === 0 || typeof used[0].photo_energy_start !== 'number') return null;
  return { name, values: [used[0].photo_energy_start, ...used.map((round) => round.photo_energy_end!)] };
}

export function energyCurves(report: Report): Curve[] {
  const tiles = report.tiles ?? [{ tile: 0, rounds: report.rounds ?? [] }];
  return tiles.map((tile) => curveOf(`tile ${tile.tile ?? 0}`, tile.rounds ?? [])).filter((c): c is Curve => c !== null);
}

const kWidth = 640, kHeight = 300, kLeft = 56, kBottom = 34, kTop = 12, kRight = 16;

export function energyPlot(curves: Curve[]): HTMLElement {
  const steps = Math.max(...curves.map((curve) => curve.values.length));
  const mean = Array.from({ length: steps }, (_, i) => {
    const known = curves.map((curve) => curve.values[i]).filter((value) => value !== undefined);
    return known.reduce((sum, value) => sum + value, 0) / known.length;
  });
  const all = curves.flatMap((curve) => curve.values);
  const low = Math.min(...all), high = Math.max(...all), span = high - low || high || 1;
  const x = (i: number) => kLeft + (i / Math.max(1, steps - 1)) * (kWidth - kLeft - kRight);
  const y = (value: number) => kTop + ((high - value) / span) * (kHeight - kTop - kBottom);
  const line = (values: number[]) => values.map((value, i) => `${i ? 'L' : 'M'}${x(i).toFixed(1)} ${y(value).toFixed(1)}`).join('');
  const label = (i: number) => (i === 0 ? 'start' : `round ${i}`);
  return h('figure', {},
    svg('svg', { class: 'plot', viewBox: `0 0 ${kWidth} ${kHeight}`, role: 'img', 'aria-label': 'Photo energy by round; the table below has the figures' },
      [0, 0.25, 0.5, 0.75, 1].map((t) => {
        const value = low + t * span;
        return [svg('line', { class: 'grid', x1: kLeft, x2: kWidth - kRight, y1: y(value), y2: y(value) }),
          svg('text', { class: 'tick', x: kLeft - 8, y: y(value) + 4, 'text-anchor': 'end' }, number(value))];
      }),
      mean.map((_, i) => svg('text', { class: 'tick', x: x(i), y: kHeight - 10, 'text-anchor': i === 0 ? 'start' : i === steps - 1 ? 'end' : 'middle' }, label(i))),
      curves.slice(0, 300).map((curve) => svg('path', { class: 'thin', d: line(curve.values) })),
      svg('path', { class: 'mean', d: line(mean) })),
    h('figcaption', { class: 'soft' }, 'Photo energy (1 − ZNCC, robust mean) at the finest level: the mean of all tiles, and each tile (thin).'),
    scrollBox('Energy of each tile', h('table', { class: 'list' },
      h('thead', {}, h('tr', {}, h('th', {}, 'Tile'), mean.map((_, i) => h('th', { class: 'number' }, label(i))))),
      h('tbody', {}, [{ name: 'mean', values: mean }, ...curves.slice(0, 300)].map((curve) => h('tr', {}, h('td', {}, curve.name),
        curve.values.map((value) => h('td', { class: 'number' }, number(value, 4)))))))));
}
