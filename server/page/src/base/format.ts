// Numbers, times and states as text.

export function thousands(value: number): string {
  return Math.round(value).toLocaleString('en-US');
}

// Few digits: 0.012, 1.23, 45.6, 1,234.
export function number(value: number, digits = 3): string {
  if (!Number.isFinite(value)) return '–';
  if (Math.abs(value) >= 1000) return thousands(value);
  return Number(value.toPrecision(digits)).toString();
}

export function percent(share: number): string {
  const value = 100 * share;
  return `${value > 0 && value < 10 ? value.toFixed(1) : Math.floor(value)}\u00a0%`;
}

export function duration(seconds: number): string {
  const s = Math.round(Math.min(Math.max(seconds, 0), 1e9));
  if (s < 60) return `${s}\u00a0s`;
  if (s < 3600) return s < 600 && s % 60 ? `${Math.floor(s / 60)}\u00a0min\u00a0${s % 60}\u00a0s` : `${Math.round(s / 60)}\u00a0min`;
  if (s < 48 * 3600) return `${Math.floor(s / 3600)}\u00a0h\u00a0${Math.floor(s / 60) % 60}\u00a0min`;
  return `${Math.floor(s / 86400)}\u00a0d\u00a0${Math.floor(s / 3600) % 24}\u00a0h`;
}

// A range of durations in one unit: "12 to 18 min".
export function durationRange(low: number, high: number): string {
  const [unit, name] = high < 90 ? [1, 's'] : high < 5400 ? [60, 'min'] : [3600, 'h'];
  const text = (s: number) => (unit === 3600 ? (s / unit).toFixed(1) : String(Math.round(s / unit)));
  return text(low) === text(high) ? `${text(high)}\u00a0${name}` : `${text(low)} to ${text(high)}\u00a0${name}`;
}

// Processor time, of one core.
export function coreTime(seconds: number): string {
  if (seconds < 60) return `${number(seconds, 2)}\u00a0core\u2011s`;
  if (seconds < 3600) return `${number(seconds / 60, 2)}\u00a0core\u2011min`;
  return `${number(seconds / 3600)}\u00a0core\u2011h`;
}

export function bytes(value: number | string | undefined): string {
  const count = Number(value ?? 0);
  if (count < 1024) return `${count}\u00a0B`;
  const units = ['KiB', 'MiB', 'GiB', 'TiB', 'PiB'];
  let unit = -1, scaled = count;
  do {
    scaled /= 1024;
    ++unit;
  } while (scaled >= 1000 && unit + 1 < units.length);
  return `${scaled >= 100 ? Math.round(scaled) : scaled.toPrecision(2)}\u00a0${units[unit]}`;
}

// A time of the coordinator's clock; with the date unless it is today.
export function clock(time: Date): string {
  const hours = time.toLocaleTimeString('en-GB', { hour: '2-digit', minute: '2-digit' });
  if (time.toDateString() === new Date().toDateString()) return hours;
  return `${time.toLocaleDateString('en-GB', { day: 'numeric', month: 'short', year: 'numeric' })}, ${hours}`;
}

export function clockSeconds(time: Date): string {
  return time.toLocaleTimeString('en-GB');
}

// "JOB_STATE_RUNNING" without its prefix, as words: "running".
export function enumWords(name: string | undefined, prefix: string): string {
  return (name ?? '').replace(prefix, '').toLowerCase().replaceAll('_', ' ') || 'unknown';
}

export function plural(count: number, one: string, many = `${one}s`): string {
  return `${thousands(count)} ${count === 1 ? one : many}`;
}

// "jobs/3" -> "3"; "workers/7" -> "7".
export function lastPart(name: string): string {
  return name.slice(name.lastIndexOf('/') + 1);
}
