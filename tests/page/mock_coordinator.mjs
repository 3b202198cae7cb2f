// A coordinator that has no workers: it serves the page and answers the HTTP API from made-up jobs. With it, tests show
// states that a real coordinator reaches only after hours: forty tiles, failures, hostile names.
import { createServer } from 'node:http';
import { createReadStream, existsSync, readFileSync, statSync } from 'node:fs';
import { extname, join, normalize } from 'node:path';

const kHostile = '<img src=x onerror="window.hacked=1">';
const kReaders = ['GetJob', 'ListJobs', 'WatchJob', 'ListTasks', 'ListAttempts', 'ListTiles', 'ListViews', 'ListArtifacts', 'ListSettings', 'QuoteJob'];
const kSubmitters = [...kReaders, 'CreateJob', 'ExportJob', 'CancelJob', 'ChangeJob', 'RetryJob'];
const kMay = { viewer: kReaders, submitter: kSubmitters, admin: [...kSubmitters, 'DeleteJob'] };
const kTypes = { '.html': 'text/html; charset=utf-8', '.js': 'text/javascript', '.css': 'text/css', '.svg': 'image/svg+xml', '.json': 'application/json', '.glb': 'model/gltf-binary' };
const kCsp = "default-src 'self'; img-src 'self' data: blob:; connect-src 'self'; worker-src 'self' blob:; style-src 'self'; frame-ancestors 'none'; base-uri 'none'; form-action 'self'";

const ago = (seconds) => new Date(Date.now() - 1000 * seconds).toISOString();

function makeJob(number, fields) {
  return {
    name: `jobs/${number}`, displayName: `city block ${number}`, scenePath: `/srv/cities/block-${number}`, state: 'JOB_STATE_SUCCEEDED', error: '',
    createTime: ago(7200), startTime: ago(7190), endTime: ago(3600), tasksTotal: 320, tasksDone: 320, tilesTotal: 40, tilesDone: 40, progress: 1, etaS: -1,
    artifacts: [], warnings: [], priority: 0, waitingFor: '', paused: false, badInput: false, artifactsTotal: 0, coreSeconds: 28800,
    predictedCoreSeconds: 27000, etaLowS: -1, etaHighS: -1, stage: '', owner: 'anna',
    settings: { tiles: 40, rounds: 0, method: 'tessera', methodSettings: { thinPlate: 0.02, levels: [], iterations: [] }, tileMemoryBytes: '4294967296',
      update: { base: '', withdraw: [], exportOnly: false }, maxCoreSeconds: 0, classifier: '', skipImages: 0, anyway: false, export: { formats: [], crs: '', color: '', gsdM: 0, classMaterials: false } },
    ...fields,
  };
}

function makeTiles(failing) {
  const tiles = [];
  for (let i = 0; i < 40; ++i) {
    const x = i % 8, y = Math.floor(i / 8), bad = failing && i === 17;
    const state = bad ? 'QUARANTINED' : i < 26 ? 'DONE' : i < 29 ? 'RUNNING' : i < 33 ? 'READY' : 'WAITING';
    tiles.push({
      tile: i, core: [{ x0M: 100 * x, y0M: 100 * y, x1M: 100 * (x + 1), y1M: 100 * (y + 1) }], state: `TILE_STATE_${state}`,
      attempts: bad ? 6 : i < 26 ? 8 : i < 29 ? 3 : 0, failedAttempts: bad ? 3 : 0, coreSeconds: i < 29 ? 300 + 40 * ((i * 7) % 11) : 0,
      predictedCoreSeconds: 500, peakBytes: i < 29 ? String((1.2 + 0.1 * ((i * 5) % 9)) * 2 ** 30) : '0', predictedPeakBytes: String(2 ** 31),
      views: [i, i + 1, i + 2], task: bad ? 'jobs/2/tasks/51' : '', title: bad ? `measure tile 17, step 4` : state === 'RUNNING' ? `solve tile ${i}, step 12` : '',
      stage: state === 'RUNNING' ? 'moving' : '', worker: bad ? 'workers/3' : state === 'RUNNING' ? `workers/${i - 25}` : '',
      reasons: bad ? ['The worker ran out of memory: 4.1 GiB of 4.0 GiB. No worker has more memory.', `worker ${kHostile} was lost`] : [],
      waitsFor: state === 'WAITING' ? [i - 1, i - 8] : [], tasksTotal: 8, tasksDone: i < 26 ? 8 : i < 29 ? 4 : 0, tasksReused: i % 9 === 0 ? 2 : 0,
      confidence: i < 26 ? 0.7 + 0.02 * (i % 10) : 0, progress: 0.5,
    });
  }
  return tiles;
}

function makeViews() {
  return Array.from({ length: 44 }, (_, i) => {
    const x = 100 * (i % 8) + 50, y = 90 * Math.floor(i / 8);
    return { image: `images/${i === 3 ? kHostile : `dji_${i}`}.jpg`, xM: x, yM: y, zM: 120, directionX: 0, directionY: 0.6, directionZ: -0.8, groundXM: x, groundYM: y, groundDirectionX: 0, groundDirectionY: 0.6,
      tilesXM: x, tilesYM: y, tilesZM: 120, tilesDirectionX: 0, tilesDirectionY: 0.6, tilesDirectionZ: -0.8 };
  });
}

function makeAttempts() {
  const attempts = [], kinds = ['cut', 'crop', 'measure', 'solve', 'mend'];
  for (let i = 0; i < 130; ++i) {
    const worker = 1 + (i % 4), start = 3000 - Math.floor(i / 4) * 85 - worker * 7, bad = i === 57 || i === 61;
    attempts.push({
      task: `jobs/2/tasks/${i}`, attempt: 1, kind: kinds[i % 5], title: `${kinds[i % 5]} tile ${i % 40}`, tile: bad ? 17 : i % 40, worker: `workers/${worker}`,
      machine: worker < 3 ? 'rack-a' : kHostile, startTime: ago(start), ...(i < 127 ? { endTime: ago(start - 60 - ((i * 13) % 22)) } : {}),
      outcome: i >= 127 ? 'ATTEMPT_OUTCOME_RUNNING' : bad ? 'ATTEMPT_OUTCOME_FAILED' : 'ATTEMPT_OUTCOME_SUCCEEDED',
      error: bad ? { errorClass: 'ERROR_CLASS_MEMORY', message: 'The worker ran out of memory: 4.1 GiB of 4.0 GiB.' } : undefined,
    });
  }
  return attempts;
}

const kSettings = {
  settings: [
    { name: 'tiles', field: 'tiles', help: 'number of tiles; 0: as many as the memory needs', kind: 'SETTING_KIND_INTEGER', minimum: 0, maximum: 100000, unit: '', defaults: {}, choices: [] },
    { name: 'tile_memory', field: 'tileMemoryBytes', help: 'largest memory of a worker for one tile', kind: 'SETTING_KIND_INTEGER', minimum: 0, maximum: 2 ** 46, unit: 'bytes', defaults: { tessera: '0', baseline: '0' }, choices: [] },
    { name: 'rounds', field: 'rounds', help: 'rounds of geometry and labels', kind: 'SETTING_KIND_INTEGER', minimum: 0, maximum: 20, unit: '', defaults: { tessera: '3', baseline: '1' }, choices: [] },
    { name: 'thin_plate', field: 'methodSettings.thinPlate', help: 'weight of the smoothness of the surface', kind: 'SETTING_KIND_NUMBER', minimum: 0, maximum: 10, unit: '', defaults: { tessera: '0.02', baseline: '0.02' }, choices: [] },
    { name: 'semantic', field: 'methodSettings.semantic', help: 'weight of the likelihoods', kind: 'SETTING_KIND_NUMBER', minimum: 0, maximum: 100, unit: '', defaults: { tessera: '1' }, choices: [] },
    { name: 'flip_edges', field: 'methodSettings.flipEdges', help: 'flip edges along creases', kind: 'SETTING_KIND_BOOLEAN', unit: '', defaults: { tessera: 'true' }, choices: [] },
    { name: 'levels', field: 'methodSettings.levels', help: 'pyramid levels, the coarsest first', kind: 'SETTING_KIND_LIST', minimum: 0, maximum: 8, unit: '', defaults: { tessera: '2,1,0' }, choices: [] },
  ],
  methods: [{ name: 'tessera', help: 'geometry and labels in turn' }, { name: 'baseline', help: 'geometry from images alone' }],
  formats: [{ name: '3dtiles', help: '3D Tiles 1.1 with levels of detail' }, { name: 'dsm', help: 'heights, GeoTIFF' }],
};

export class MockCoordinator {
  // `page`: the folder that server/page/build made. `tiles`: a folder that is served as export/ of job 1, or null.
  constructor(page, tiles) {
    Object.assign(this, { page, tiles, sessions: new Map(), streams: new Set(), streamsAllowed: true, surveyed: true, viewsAsked: 0, calls: [], port: 0 });
    this.jobs = [
      makeJob(2, { displayName: kHostile, owner: kHostile, state: 'JOB_STATE_RUNNING', endTime: undefined, createTime: ago(3100), startTime: ago(3050), tasksDone: 214, tilesDone: 26, progress: 0.63, etaLowS: 900, etaHighS: 1300, etaS: 1100,
        stage: `solving step 12 of 26, 26 of 40 tiles`, warnings: [`warning ${kHostile}`, 'image dji_7 is not sharp'], coreSeconds: 9400, predictedCoreSeconds: 15000, priority: 5 }),
      makeJob(3, { displayName: 'harbour', state: 'JOB_STATE_QUEUED', startTime: undefined, endTime: undefined, createTime: ago(610), tasksDone: 0, tasksTotal: 0, tilesTotal: 0, tilesDone: 0, progress: 0, coreSeconds: 0, predictedCoreSeconds: 0, waitingFor: 'jobs of higher priority run first', owner: 'bert' }),
      makeJob(4, { displayName: 'old town', state: 'JOB_STATE_PARTIAL', error: 'tile 17 is quarantined: the worker ran out of memory', progress: 1, owner: 'bert' }),
      makeJob(5, { displayName: 'airport', state: 'JOB_STATE_FAILED', error: 'images/7.jpg: not a JPEG file: found "GIF8"', progress: 0.1, tilesDone: 0, coreSeconds: 12 }),
      makeJob(6, { displayName: 'river bank', paused: true, state: 'JOB_STATE_RUNNING', endTime: undefined, progress: 0.4, tilesDone: 12, etaLowS: -1, etaHighS: -1 }),
      makeJob(1, { displayName: 'demo city', artifacts: this.artifacts(), artifactsTotal: this.artifacts().length }),
    ];
    this.version = 1;
    this.server = createServer((request, response) => this.answer(request, response).catch((error) => {
      response.writeHead(500);
      response.end(String(error));
    }));
  }

  artifacts() {
    const names = ['mesh.ply', 'report.json', 'report.html', 'job.json'];
    if (this.tiles) names.push('export/3dtiles/result/tileset.json', 'export/3dtiles/start/tileset.json');
    return names.map((name) => ({ name, digest: { sha256: '00', sizeBytes: '123456789' } }));
  }

  async listen(port = 0) {
    await new Promise((resolve) => this.server.listen(port, '127.0.0.1', resolve));
    this.port = this.server.address().port;
    return `http://127.0.0.1:${this.port}/`;
  }

  // As a process that is killed: connections break, sessions are forgotten.
  async stop() {
    this.sessions.clear();
    this.server.closeAllConnections?.();
    await new Promise((resolve) => { this.server.close(resolve); this.server.closeAllConnections?.(); });
  }

  change(name, fields) {
    Object.assign(this.jobs.find((job) => job.name === name), fields);
    ++this.version;
    for (const stream of this.streams) this.send(stream);
  }

  state(name) {
    const job = this.jobs.find((each) => each.name === name);
    return job && { job, running: name !== 'jobs/2' ? [] : [26, 27, 28].map((tile) => ({ name: `jobs/2/tasks/${tile}`, kind: 'solve', title: `solve tile ${tile}, step 12`, tile, state: 'TASK_STATE_LEASED',
      attempt: 1, worker: `workers/${tile - 25}`, progress: 0.4, stage: 'moving', predictedPeakBytes: String(2 ** 30), cost: 30 })), etag: `v${this.version}` };
  }

  send({ response, name }) {
    const state = this.state(name);
    response.write(`id: ${state.etag}\ndata: ${JSON.stringify(state)}\n\n`);
  }

  async answer(request, response) {
    const url = new URL(request.url, 'http://host'), path = decodeURIComponent(url.pathname);
    const reply = (status, body, headers = {}) => {
      response.writeHead(status, { 'Content-Type': 'application/json', 'Content-Security-Policy': kCsp, 'X-Content-Type-Options': 'nosniff', 'Cache-Control': 'no-store', ...headers });
      response.end(body === undefined ? '' : JSON.stringify(body));
    };
    const refuse = (status, code, message) => reply(status, { code, message });
    const file = (name) => {
      if (!existsSync(name) || !statSync(name).isFile()) return refuse(404, 'NOT_FOUND', 'no such file');
      response.writeHead(200, { 'Content-Type': kTypes[extname(name)] ?? 'application/octet-stream', 'Content-Security-Policy': kCsp, 'X-Content-Type-Options': 'nosniff', 'Content-Length': statSync(name).size });
      createReadStream(name).pipe(response);
    };
    if (path === '/') return file(join(this.page, 'index.html'));
    if (path.startsWith('/assets/')) return file(join(this.page, normalize(path)));
    let body = '';
    for await (const chunk of request) body += chunk;
    const message = body ? JSON.parse(body) : {};
    if (request.method !== 'GET' && request.headers['x-tessera'] !== '1') return refuse(403, 'PERMISSION_DENIED', 'the header X-Tessera is missing');
    const cookie = /tessera_session=(\w+)/.exec(request.headers.cookie ?? '')?.[1] ?? '';
    const session = (role, name) => ({ name, role, tokensRequired: true, version: '1.0', httpsOnly: false, may: [...kMay[role].map((rpc) => `/tessera.v1.Jobs/${rpc}`), '/tessera.v1.Workers/ListWorkers'] });
    if (path === '/api/v1/session' && request.method === 'POST') {
      const role = /^(viewer|submitter|admin)-token$/.exec(message.token)?.[1];
      if (!role) return refuse(401, 'UNAUTHENTICATED', 'unauthenticated: the token is unknown or has expired');
      const id = Math.random().toString(16).slice(2);
      this.sessions.set(id, session(role, role === 'viewer' ? kHostile : 'anna'));
      return reply(200, this.sessions.get(id), { 'Set-Cookie': `tessera_session=${id}; HttpOnly; SameSite=Strict; Path=/` });
    }
    const who = this.sessions.get(cookie);
    if (!who) return refuse(401, 'UNAUTHENTICATED', 'unauthenticated: log in');
    if (path === '/api/v1/session') {
      if (request.method === 'DELETE') this.sessions.delete(cookie);
      return reply(200, who);
    }
    if (request.method !== 'GET') this.calls.push({ method: request.method, path, body: message });
    const withEtag = (value, etag) => (request.headers['if-none-match'] === `"${etag}"` ? reply(304, undefined, { ETag: `"${etag}"` }) : reply(200, value, { ETag: `"${etag}"` }));
    if (path === '/api/v1/settings') return reply(200, kSettings);
    if (path === '/api/v1/workers') return reply(200, { workers: this.workers(), nextPageToken: '' });
    if (path === '/api/v1/quote') {
      if (!message.scenePath.startsWith('/srv/cities')) return refuse(400, 'INVALID_ARGUMENT', `${message.scenePath}: not below a scene root`);
      return reply(200, { warnings: [`scene.json: an unknown key ${kHostile}`], images: 240, pixels: 4.8e9, meshFaces: '1800000', surveyedBy: '', tiles: { low: 36, high: 44 }, coreSeconds: { low: 20000, high: 31000 },
        peakBytes: { low: 2.1e9, high: 3.9e9 }, storedBytes: { low: 4e10, high: 6e10 }, areaM2: { low: 4e5, high: 4e5 }, gsdM: 0.1, estimated: ['core_seconds', 'tiles'], basis: 'poses and image sizes' });
    }
    if (path === '/api/v1/jobs' && request.method === 'GET') return withEtag({ jobs: this.jobs, nextPageToken: '' }, `v${this.version}`);
    if (path === '/api/v1/jobs') {
      const number = 10 + this.jobs.length;
      this.jobs.unshift(makeJob(number, { displayName: message.displayName, state: 'JOB_STATE_QUEUED', startTime: undefined, endTime: undefined, progress: 0, createTime: ago(0) }));
      ++this.version;
      return reply(200, this.jobs[0]);
    }
    if (path.startsWith('/files/jobs/1/export/') && this.tiles) return file(join(this.tiles, normalize(path.slice('/files/jobs/1/export/'.length))));
    if (path.startsWith('/files/jobs/1/')) {
      if (path.endsWith('report.json')) return reply(200, this.report());
      if (path.endsWith('report.html')) { response.writeHead(200, { 'Content-Type': 'text/html' }); return response.end(this.reportPage()); }
      return refuse(404, 'NOT_FOUND', 'no such file');
    }
    const [, name, rest] = /^\/api\/v1\/(jobs\/\d+)(.*)$/.exec(path) ?? [];
    const job = this.jobs.find((each) => each.name === name);
    if (!job) return refuse(404, 'NOT_FOUND', `${path}: no such job`);
    if (rest === '' && request.method === 'GET') return reply(200, job);
    if (rest === ':state') return withEtag(this.state(name), `v${this.version}`);
    if (rest === ':watch') {
      if (!this.streamsAllowed) { response.writeHead(503, { 'Retry-After': '2' }); return response.end(); }
      response.writeHead(200, { 'Content-Type': 'text/event-stream', 'Cache-Control': 'no-store' });
      const stream = { response, name };
      this.streams.add(stream);
      request.on('close', () => this.streams.delete(stream));
      if (url.searchParams.get('seenEtag') !== this.state(name).etag) this.send(stream);
      else response.write(': nothing new\n\n');
      return undefined;
    }
    if (rest === '/tiles') return reply(200, { tiles: name === 'jobs/5' || name === 'jobs/3' || !this.surveyed ? [] : this.tilesOf(name), nextPageToken: '' });
    if (rest === '/views') {
      ++this.viewsAsked;
      return reply(200, { views: this.surveyed ? makeViews() : [], nextPageToken: '' });
    }
    if (rest === '/attempts') {
      const tile = url.searchParams.get('tile');
      return reply(200, { attempts: makeAttempts().filter((each) => tile === null || each.tile === Number(tile)), nextPageToken: '' });
    }
    if (rest === ':locate') {
      const [x, y, z] = ['xM', 'yM', 'zM'].map((each) => Number(url.searchParams.get(each)));
      return reply(200, { crs: `CH1903+ / LV95 (EPSG:2056) ${kHostile}`, x: 2_600_000 + x, y: 1_200_000 + y, z: 500 + z, sceneXM: x, sceneYM: y, sceneZM: z, onGlobe: true, latitudeDeg: 46.951082 + y / 111_000,
        longitudeDeg: 7.438637 + x / 76_000, heightM: 550 + z, groundXM: x, groundYM: y, tile: x < 0 || y < 0 || x >= 800 || y >= 500 ? -1 : Math.floor(x / 100) + 8 * Math.floor(y / 100) });
    }
    if (rest === '/artifacts') return reply(200, { artifacts: job.artifacts, nextPageToken: '' });
    if (rest === ':export') {
      this.jobs.unshift(makeJob(50, { displayName: 'export', state: 'JOB_STATE_RUNNING', progress: 0.5, endTime: undefined, settings: { ...job.settings, update: { base: name, exportOnly: true }, export: { formats: ['3dtiles'] } } }));
      ++this.version;
      return reply(200, this.jobs[0]);
    }
    if (request.method === 'DELETE') this.jobs = this.jobs.filter((each) => each !== job);
    if (request.method === 'PATCH') Object.assign(job, message);
    if (rest === ':cancel') Object.assign(job, { state: 'JOB_STATE_CANCELLED', endTime: ago(0) });
    if (rest === ':retry') Object.assign(job, { state: 'JOB_STATE_RUNNING', error: '', endTime: undefined });
    ++this.version;
    return reply(200, request.method === 'DELETE' ? {} : job);
  }

  tilesOf(name) {
    const tiles = makeTiles(name === 'jobs/2' || name === 'jobs/4');
    return name === 'jobs/2' ? tiles : tiles.map((tile) => (tile.state === 'TILE_STATE_QUARANTINED' ? tile : { ...tile, state: 'TILE_STATE_DONE', waitsFor: [], tasksDone: 8, attempts: 8, coreSeconds: 300 + 11 * tile.tile, peakBytes: String(2 ** 30), confidence: 0.8 }));
  }

  workers() {
    const worker = (n, fields) => ({ name: `workers/${n}`, host: n === 4 ? kHostile : `rack-${n}`, pid: 1000 + n, threads: 16, memoryBytes: String(8 * 2 ** 30), tasks: [], lastSeenS: 1, suspendedReason: '', suspendedS: 0, allocation: '', timeLeftS: 0, ...fields });
    return [worker(1, { tasks: ['jobs/2/tasks/26'] }), worker(2, { tasks: ['jobs/2/tasks/27'] }), worker(3, { suspendedReason: 'its scratch folder is full: 1.2 GiB free, 4 GiB needed', suspendedS: 40 }), worker(4, { lastSeenS: 48 })];
  }

  report() {
    const rounds = (k) => [0, 1, 2].map((r) => ({ photo_energy_start: 0.42 - 0.05 * r + 0.004 * k, photo_energy_end: 0.36 - 0.045 * r + 0.003 * k }));
    return { gsd_m: 0.1, tiles: [0, 1, 2, 3, 4, 5].map((tile) => ({ tile, rounds: rounds(tile) })) };
  }

  reportPage() {
    const picture = 'data:image/svg+xml;base64,' + Buffer.from('<svg xmlns="http://www.w3.org/2000/svg" width="640" height="400"><rect width="640" height="400" fill="#9fb6cc"/></svg>').toString('base64');
    return `<!doctype html><script>window.hacked=1</script><figure><img src="${picture}"><figcaption>Start</figcaption></figure><figure><img src="${picture}"><figcaption>Result</figcaption></figure>`;
  }
}

// node mock_coordinator.mjs PAGE [TILES]: serves until it is ended.
if (process.argv[1] === new URL(import.meta.url).pathname) {
  console.log(await new MockCoordinator(process.argv[2], process.argv[3] ?? null).listen(8899));
}
