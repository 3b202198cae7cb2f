// What colours the tiles of the map: a state or a figure of each tile.
import type { Tile } from '../api/types';
import { bytes, duration, enumWords, number, percent } from '../base/format';

export interface TileState { id: string; name: string; color: string; mark: string }

// `mark`: a sign on the tile, so that no state is known by its colour alone.
export const kTileStates: TileState[] = [
  { id: 'TILE_STATE_WAITING', name: 'waiting', color: '#c3ccd5', mark: '' },
  { id: 'TILE_STATE_READY', name: 'ready', color: '#a9d0f5', mark: '…' },
  { id: 'TILE_STATE_RUNNING', name: 'running', color: '#2f7fd6', mark: '▶' },
  { id: 'TILE_STATE_DONE', name: 'done', color: '#3f9a64', mark: '✓' },
  { id: 'TILE_STATE_FAILED', name: 'failed', color: '#d23b45', mark: '✕' },
  { id: 'TILE_STATE_QUARANTINED', name: 'quarantined', color: '#e08a1e', mark: '!' },
  { id: 'TILE_STATE_CANCELLED', name: 'cancelled', color: '#7d8791', mark: '–' },
  { id: 'TILE_STATE_KEPT', name: 'kept from the base job', color: '#a9cdb7', mark: '=' },
];

export function tileState(tile: Tile): TileState {
  return kTileStates.find((state) => state.id === tile.state) ??
    { id: tile.state, name: enumWords(tile.state, 'TILE_STATE_'), color: '#c3ccd5', mark: '?' };
}

export function isBad(tile: Tile): boolean {
  return tile.state === 'TILE_STATE_FAILED' || tile.state === 'TILE_STATE_QUARANTINED';
}

export interface Layer {
  id: string;
  name: string;
  value?(tile: Tile): number; // below 0: not known; none: the layer of states
  text?(value: number): string;
}

export const kLayers: Layer[] = [
  { id: 'state', name: 'State' },
  { id: 'seconds', name: 'Processor time', value: (tile) => tile.coreSeconds || -1, text: (v) => duration(v) },
  { id: 'predicted', name: 'Predicted processor time', value: (tile) => tile.predictedCoreSeconds || -1, text: (v) => duration(v) },
  { id: 'memory', name: 'Memory', value: (tile) => Number(tile.peakBytes) || -1, text: (v) => bytes(v) },
  { id: 'attempts', name: 'Attempts', value: (tile) => tile.attempts, text: (v) => number(v) },
  { id: 'confidence', name: 'Confidence of labels', value: (tile) => tile.confidence || -1, text: (v) => percent(v) },
];

const kViridis = ['#440154', '#482878', '#3e4a89', '#31688e', '#26828e', '#1f9e89', '#35b779', '#6ece58', '#b5de2b', '#fde725'];

function mix(a: string, b: string, t: number): string {
  const at = (hex: string, k: number) => parseInt(hex.slice(1 + 2 * k, 3 + 2 * k), 16);
  return `#${[0, 1, 2].map((k) => Math.round(at(a, k) + t * (at(b, k) - at(a, k))).toString(16).padStart(2, '0')).join('')}`;
}

// `t` in [0, 1].
export function viridis(t: number): string {
  const at = Math.min(Math.max(t, 0), 1) * (kViridis.length - 1), i = Math.min(Math.floor(at), kViridis.length - 2);
  return mix(kViridis[i], kViridis[i + 1], at - i);
}

export const kUnknownFill = '#e4e8ec';

export interface Scale { low: number; high: number }

export function scaleOf(layer: Layer, tiles: Tile[]): Scale | null {
  let low = Infinity, high = -Infinity;
  for (const tile of tiles) {
    const value = layer.value?.(tile) ?? -1;
    if (value < 0) continue;
    low = Math.min(low, value);
    high = Math.max(high, value);
  }
  return high >= low ? { low, high } : null;
}

export function fillOf(layer: Layer, scale: Scale | null, tile: Tile): string {
  if (!layer.value) return tileState(tile).color;
  const value = layer.value(tile);
  if (value < 0 || !scale) return kUnknownFill;
  return viridis(scale.high > scale.low ? (value - scale.low) / (scale.high - scale.low) : 0.5);
}
