// Messages of proto/tessera/v1 as protobuf's JSON: enums by name, 64-bit integers as text, times as RFC 3339.

export interface Digest { sha256: string; sizeBytes: string }
export interface Artifact { name: string; digest: Digest }

export interface ExportSettings {
  formats: string[]; crs: string; color: string; gsdM: number; classMaterials: boolean;
}
export interface UpdateSettings {
  base: string; withdraw: string[]; allEpochs: boolean; fromScratch: boolean; planOnly: boolean; rollbackTo: string;
  rollbackTiles: number[]; exportOnly: boolean;
}
export interface JobSettings {
  tiles: number; rounds: number; method: string; methodSettings?: Record<string, unknown>; tileMemoryBytes: string;
  update?: UpdateSettings; maxCoreSeconds: number; classifier: string; skipImages: number; anyway: boolean;
  export?: ExportSettings;
}
export interface Job {
  name: string; displayName: string; scenePath: string; settings?: JobSettings; state: string; error: string;
  createTime?: string; startTime?: string; endTime?: string; tasksTotal: number; tasksDone: number; tilesTotal: number;
  tilesDone: number; progress: number; etaS: number; artifacts: Artifact[]; warnings: string[]; priority: number;
  waitingFor: string; paused: boolean; badInput: boolean; artifactsTotal: number; coreSeconds: number;
  predictedCoreSeconds: number; etaLowS: number; etaHighS: number; stage: string; owner: string;
}
export interface ListJobs { jobs: Job[]; nextPageToken: string }

export interface TaskError { errorClass: string; message: string }
export interface Task {
  name: string; kind: string; title: string; tile: number; state: string; attempt: number; worker: string;
  progress: number; stage: string; cost: number; reused: boolean; error?: TaskError; statsJson: string;
  startTime?: string; endTime?: string; warnings: string[]; predictedPeakBytes: string;
  usage?: { coreSeconds: number; peakBytes: string; threads: number }; superseded: boolean;
}
export interface WatchJob { job: Job; running: Task[]; etag: string }

export interface Attempt {
  task: string; attempt: number; kind: string; title: string; tile: number; worker: string; machine: string;
  startTime?: string; endTime?: string; outcome: string; error?: TaskError;
}

export interface GroundRectangle { x0M: number; y0M: number; x1M: number; y1M: number }
export interface Tile {
  tile: number; core: GroundRectangle[]; state: string; attempts: number; failedAttempts: number; coreSeconds: number;
  predictedCoreSeconds: number; peakBytes: string; predictedPeakBytes: string; views: number[]; task: string;
  title: string; stage: string; worker: string; reasons: string[]; waitsFor: number[]; tasksTotal: number;
  tasksDone: number; tasksReused: number; confidence: number; progress: number;
}
export interface View {
  image: string; xM: number; yM: number; zM: number; directionX: number; directionY: number; directionZ: number;
  groundXM: number; groundYM: number; groundDirectionX: number; groundDirectionY: number;
  tilesXM: number; tilesYM: number; tilesZM: number;
  tilesDirectionX: number; tilesDirectionY: number; tilesDirectionZ: number;
}
export interface Located {
  crs: string; x: number; y: number; z: number; sceneXM: number; sceneYM: number; sceneZM: number; onGlobe: boolean;
  latitudeDeg: number; longitudeDeg: number; heightM: number; groundXM: number; groundYM: number; tile: number;
}

export interface Worker {
  name: string; host: string; pid: number; threads: number; memoryBytes: string; tasks: string[]; lastSeenS: number;
  suspendedReason: string; suspendedS: number; allocation: string; timeLeftS: number;
}

export interface Setting {
  name: string; field: string; help: string; kind: string; minimum?: number; maximum?: number; unit: string;
  defaults: Record<string, string>; choices: string[];
}
export interface NamedChoice { name: string; help: string }
export interface Settings { settings: Setting[]; methods: NamedChoice[]; formats: NamedChoice[] }

export interface Interval { low: number; high: number }
export interface Quote {
  settings?: JobSettings; warnings: string[]; images: number; pixels: number; meshFaces: string; surveyedBy: string;
  tiles?: Interval; coreSeconds?: Interval; peakBytes?: Interval; storedBytes?: Interval; areaM2?: Interval;
  gsdM: number; estimated: string[]; basis: string;
}

export interface Session {
  name: string; role: string; tokensRequired: boolean; version: string; may: string[]; httpsOnly: boolean;
}

const kEnded = ['JOB_STATE_SUCCEEDED', 'JOB_STATE_FAILED', 'JOB_STATE_CANCELLED', 'JOB_STATE_PARTIAL'];

export function hasEnded(job: Job): boolean {
  return kEnded.includes(job.state);
}

export function hasResult(job: Job): boolean {
  return job.state === 'JOB_STATE_SUCCEEDED' || job.state === 'JOB_STATE_PARTIAL';
}

export function jobTitle(job: Job): string {
  return job.displayName || job.name;
}
