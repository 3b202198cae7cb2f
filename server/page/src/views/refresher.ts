// Repeats a request when it is asked for, but not more often than its cost allows.

export class Refresher {
  private running = false;
  private wanted = false;
  private last_ms = 0;
  private cost_ms = 0;

  // At least `interval_ms` lie between two starts, and ten times the duration of the last request.
  constructor(public interval_ms: number, private readonly request_: () => Promise<void>) {}

  request(): void {
    if (this.running || this.wanted) {
      this.wanted = true;
      return;
    }
    const wait_ms = this.last_ms === 0 ? 0 : this.last_ms + Math.max(this.interval_ms, 10 * this.cost_ms) - Date.now();
    this.wanted = true;
    setTimeout(() => void this.start(), Math.max(0, wait_ms));
  }

  private async start(): Promise<void> {
    this.wanted = false;
    this.running = true;
    this.last_ms = Date.now();
    try {
      await this.request_();
    } finally {
      this.cost_ms = Date.now() - this.last_ms;
      this.running = false;
      if (this.wanted) {
        this.wanted = false;
        this.request();
      }
    }
  }
}
