// Whether the coordinator answers, and its clock.

let awaySince: Date | null = null;
let offset_ms = 0; // of the coordinator's clock from this machine's
let offsetKnown = false;
const listeners = new Set<() => void>();

export function isAwaySince(): Date | null {
  return awaySince;
}

// Calls `listener` whenever the coordinator stops or begins to answer.
export function onConnectionChange(listener: () => void): void {
  listeners.add(listener);
}

export function reportAnswer(date: string | null): void {
  const server_ms = date ? Date.parse(date) : NaN;
  // The header has whole seconds; small differences are left out, so that times do not jump.
  if (Number.isFinite(server_ms)) {
    const found_ms = server_ms + 500 - Date.now();
    if (!offsetKnown || Math.abs(found_ms - offset_ms) > 1500) offset_ms = Math.abs(found_ms) < 1500 ? 0 : found_ms;
    offsetKnown = true;
  }
  if (!awaySince) return;
  awaySince = null;
  for (const listener of listeners) listener();
}

export function reportSilence(): void {
  if (awaySince) return;
  awaySince = new Date();
  for (const listener of listeners) listener();
}

// Now, by the coordinator's clock.
export function now_ms(): number {
  return Date.now() + offset_ms;
}
