// From the tile set's east-north-up frame to the scene's coordinates and to the globe (WGS 84), and back.

export type Vec = [number, number, number];

const kA = 6378137, kF = 1 / 298.257223563, kE2 = kF * (2 - kF), kRad = Math.PI / 180;

export interface Geodetic { lat_deg: number; lon_deg: number; height_m: number }

export function geodeticFromEcef([x, y, z]: Vec): Geodetic {
  const p = Math.hypot(x, y);
  let lat = Math.atan2(z, p * (1 - kE2)), height = 0;
  for (let i = 0; i < 12; ++i) {
    const n = kA / Math.sqrt(1 - kE2 * Math.sin(lat) ** 2);
    height = p * Math.cos(lat) + z * Math.sin(lat) - (kA * kA) / n;
    lat = Math.atan2(z, p * (1 - (kE2 * n) / (n + height)));
  }
  return { lat_deg: lat / kRad, lon_deg: Math.atan2(y, x) / kRad, height_m: height };
}

export function ecefFromGeodetic({ lat_deg, lon_deg, height_m }: Geodetic): Vec {
  const lat = lat_deg * kRad, lon = lon_deg * kRad, n = kA / Math.sqrt(1 - kE2 * Math.sin(lat) ** 2);
  return [(n + height_m) * Math.cos(lat) * Math.cos(lon), (n + height_m) * Math.cos(lat) * Math.sin(lon),
    (n * (1 - kE2) + height_m) * Math.sin(lat)];
}

// Transverse Mercator by Krüger's series to the fourth order in n (below 0.1 mm within a zone): Karney, "Transverse
// Mercator with an accuracy of a few nanometers", 2011, equations 35 and 36.
const kN = kF / (2 - kF), kK0 = 0.9996;
const kRadius = (kA / (1 + kN)) * (1 + kN ** 2 / 4 + kN ** 4 / 64);
const kAlpha = [kN / 2 - (2 / 3) * kN ** 2 + (5 / 16) * kN ** 3 + (41 / 180) * kN ** 4, (13 / 48) * kN ** 2 - (3 / 5) * kN ** 3 + (557 / 1440) * kN ** 4,
  (61 / 240) * kN ** 3 - (103 / 140) * kN ** 4, (49561 / 161280) * kN ** 4];
const kBeta = [kN / 2 - (2 / 3) * kN ** 2 + (37 / 96) * kN ** 3 - (1 / 360) * kN ** 4, (1 / 48) * kN ** 2 + (1 / 15) * kN ** 3 - (437 / 1440) * kN ** 4,
  (17 / 480) * kN ** 3 - (37 / 840) * kN ** 4, (4397 / 161280) * kN ** 4];

export function utmFromGeodetic(g: Geodetic, zone: number, north: boolean): Vec {
  const lat = g.lat_deg * kRad, lambda = (g.lon_deg - (6 * zone - 183)) * kRad, e = Math.sqrt(kE2);
  const t = Math.sinh(Math.atanh(Math.sin(lat)) - e * Math.atanh(e * Math.sin(lat)));
  const xi = Math.atan2(t, Math.cos(lambda)), eta = Math.asinh(Math.sin(lambda) / Math.hypot(t, Math.cos(lambda)));
  let x = xi, y = eta;
  kAlpha.forEach((a, i) => {
    const j = 2 * (i + 1);
    x += a * Math.sin(j * xi) * Math.cosh(j * eta);
    y += a * Math.cos(j * xi) * Math.sinh(j * eta);
  });
  return [500_000 + kK0 * kRadius * y, (north ? 0 : 10_000_000) + kK0 * kRadius * x, g.height_m];
}

export function geodeticFromUtm([easting, northing, height_m]: Vec, zone: number, north: boolean): Geodetic {
  const xi = (northing - (north ? 0 : 10_000_000)) / (kK0 * kRadius), eta = (easting - 500_000) / (kK0 * kRadius);
  let x = xi, y = eta;
  kBeta.forEach((b, i) => {
    const j = 2 * (i + 1);
    x -= b * Math.sin(j * xi) * Math.cosh(j * eta);
    y -= b * Math.cos(j * xi) * Math.sinh(j * eta);
  });
  const e = Math.sqrt(kE2), target = Math.sin(x) / Math.hypot(Math.sinh(y), Math.cos(x));
  let tau = target; // tan(lat), by Newton's method on the conformal latitude
  for (let i = 0; i < 6; ++i) {
    const root = Math.hypot(1, tau), sigma = Math.sinh(e * Math.atanh((e * tau) / root));
    const found = tau * Math.hypot(1, sigma) - sigma * root;
    tau += ((target - found) / Math.hypot(1, found)) * (1 + (1 - kE2) * tau * tau) / ((1 - kE2) * root);
  }
  return { lat_deg: Math.atan(tau) / kRad, lon_deg: 6 * zone - 183 + Math.atan2(Math.sinh(y), Math.cos(x)) / kRad, height_m };
}

// "frame" of report.json.
export interface FrameJson {
  crs: { type: string; lat_deg?: number; lon_deg?: number; height_m?: number; zone?: number; north?: boolean; epsg?: number; geoid_height_m?: number };
  origin_in_scene: number[];
  rotation_local_from_scene: number[] | number[][];
  up: number[];
}

type Rows = [Vec, Vec, Vec];
const dot = (a: Vec, b: Vec) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
const times = (m: Rows, v: Vec): Vec => [dot(m[0], v), dot(m[1], v), dot(m[2], v)];
const transposed = (m: Rows): Rows => [[m[0][0], m[1][0], m[2][0]], [m[0][1], m[1][1], m[2][1]], [m[0][2], m[1][2], m[2][2]]];
const minus = (a: Vec, b: Vec): Vec => [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
const plus = (a: Vec, b: Vec): Vec => [a[0] + b[0], a[1] + b[1], a[2] + b[2]];

// Rows: east, north, up at a place on the globe.
function axesAt(lat_deg: number, lon_deg: number): Rows {
  const lat = lat_deg * kRad, lon = lon_deg * kRad;
  return [[-Math.sin(lon), Math.cos(lon), 0], [-Math.sin(lat) * Math.cos(lon), -Math.sin(lat) * Math.sin(lon), Math.cos(lat)],
    [Math.cos(lat) * Math.cos(lon), Math.cos(lat) * Math.sin(lon), Math.sin(lat)]];
}

// The axes of the ground plane, as MakeGroundPlane of common/job/ground.h.
function groundAxes(up: Vec): Rows {
  if (up[0] === 0 && up[1] === 0 && up[2] === 1) return [[1, 0, 0], [0, 1, 0], [0, 0, 1]];
  let least = 0;
  for (let k = 1; k < 3; ++k) if (Math.abs(up[k]) < Math.abs(up[least])) least = k;
  const axis: Vec = [0, 0, 0];
  axis[least] = 1;
  const along = minus(axis, up.map((u) => u * dot(up, axis)) as Vec), length = Math.hypot(...along);
  const x = along.map((a) => a / length) as Vec;
  return [x, [up[1] * x[2] - up[2] * x[1], up[2] * x[0] - up[0] * x[2], up[0] * x[1] - up[1] * x[0]], up];
}

export interface Place { name: string; p: Vec }

// Converts points of the tile set: metres east, north and up of its origin.
export class SceneFrame {
  private readonly axes: Rows | null; // of the tile set on the globe
  private readonly origin_ecef: Vec;
  private readonly ground: Rows;
  private readonly rotation: Rows;
  private readonly origin: Vec;

  // `transform`: of the root of tileset.json, by columns; null: the tile set has no place on the globe. `frame`: null if
  // there is no report.json.
  constructor(transform: number[] | null, private readonly frame: FrameJson | null) {
    const t = transform;
    this.axes = t && [[t[0], t[1], t[2]], [t[4], t[5], t[6]], [t[8], t[9], t[10]]];
    this.origin_ecef = t ? [t[12], t[13], t[14]] : [0, 0, 0];
    this.ground = groundAxes((frame && !t ? frame.up : [0, 0, 1]) as Vec);
    const r = frame ? frame.rotation_local_from_scene.flat() as number[] : [1, 0, 0, 0, 1, 0, 0, 0, 1];
    this.rotation = [[r[0], r[1], r[2]], [r[3], r[4], r[5]], [r[6], r[7], r[8]]];
    this.origin = (frame?.origin_in_scene ?? [0, 0, 0]) as Vec;
  }

  geodetic(enu: Vec): Geodetic | null {
    return this.axes && geodeticFromEcef(this.ecef(enu));
  }

  // In the scene's coordinates; null if the page cannot compute them.
  scene(enu: Vec): Place | null {
    const crs = this.frame?.crs;
    if (!crs) return null;
    if (!this.axes) {
      return { name: 'local coordinates', p: plus(times(transposed(this.rotation), times(transposed(this.ground), enu)), this.origin) };
    }
    const ecef = this.ecef(enu), utm = this.utm();
    if (crs.type === 'ecef') return { name: 'ECEF', p: ecef };
    if (crs.type === 'enu') {
      const at = { lat_deg: crs.lat_deg ?? 0, lon_deg: crs.lon_deg ?? 0, height_m: crs.height_m ?? 0 };
      return { name: `ENU ${at.lat_deg}, ${at.lon_deg}`, p: times(axesAt(at.lat_deg, at.lon_deg), minus(ecef, ecefFromGeodetic(at))) };
    }
    if (!utm) return null;
    const p = utmFromGeodetic(geodeticFromEcef(ecef), utm.zone, utm.north);
    return { name: crs.epsg ? `EPSG:${crs.epsg}` : `UTM ${utm.zone} ${utm.north ? 'north' : 'south'}`, p: [p[0], p[1], p[2] - (crs.geoid_height_m ?? 0)] };
  }

  // Of the scene's coordinates; null if the page cannot compute them.
  enu(scene: Vec): Vec | null {
    const crs = this.frame?.crs;
    if (!crs) return null;
    if (!this.axes) return times(this.ground, times(this.rotation, minus(scene, this.origin)));
    const utm = this.utm();
    let ecef: Vec;
    if (crs.type === 'ecef') ecef = scene;
    else if (crs.type === 'enu') {
      const at = { lat_deg: crs.lat_deg ?? 0, lon_deg: crs.lon_deg ?? 0, height_m: crs.height_m ?? 0 };
      ecef = plus(times(transposed(axesAt(at.lat_deg, at.lon_deg)), scene), ecefFromGeodetic(at));
    } else if (utm) {
      ecef = ecefFromGeodetic(geodeticFromUtm([scene[0], scene[1], scene[2] + (crs.geoid_height_m ?? 0)], utm.zone, utm.north));
    } else return null;
    return times(this.axes, minus(ecef, this.origin_ecef));
  }

  // On the ground plane, as GroundRectangle; null if the page cannot compute it.
  onGround(enu: Vec): [number, number] | null {
    if (!this.axes) return [enu[0], enu[1]];
    const scene = this.scene(enu);
    if (!scene) return null;
    const local = times(this.rotation, minus(scene.p, this.origin));
    return [local[0], local[1]];
  }

  private ecef(enu: Vec): Vec {
    return plus(times(transposed(this.axes!), enu), this.origin_ecef);
  }

  // The zone of a UTM scene, also one given by its EPSG code.
  private utm(): { zone: number; north: boolean } | null {
    const crs = this.frame?.crs;
    if (crs?.type === 'utm') return { zone: crs.zone ?? 0, north: crs.north ?? true };
    const epsg = crs?.type === 'projected' ? crs.epsg ?? 0 : 0, zone = epsg % 100;
    if (zone < 1 || zone > 60) return null;
    const series = Math.floor(epsg / 100);
    return series === 326 || (series === 258 && zone >= 28 && zone <= 38) ? { zone, north: true }
      : series === 327 ? { zone, north: false } : null;
  }
}
