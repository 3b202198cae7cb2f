// The drawing of start and result, with a divider between them: left of it the start, right of it the result.
import { Box3, BufferAttribute, BufferGeometry, Color, LineBasicMaterial, LineSegments, Matrix4, type Mesh, PerspectiveCamera, Raycaster,
  Scene, Sphere, Vector2, Vector3, WebGLRenderer } from 'three';
import { MapControls } from 'three/addons/controls/MapControls.js';
import { fitCorners, type Vec } from './fit';
import { type ColorMode, enuFromWorld, type SurfaceClass, SurfaceLook, worldFromEnu } from './surface_material';
import { type Attributes, TileSet } from './tile_set';

export interface TileSetAddress { url: string; transform: number[] | null }
export interface Hit { side: 'start' | 'result'; enu: Vec; classIndex: number; confidence: number | null; displacement: number | null }
export interface Mark { enu: Vec; element: HTMLElement }

const kErrorTarget_px = 8, kMaxTriangles = 1_500_000;
const kFilled = 0.96; // share of the view that showAll fills

const kFromSouth = new Vector3(-0.25, 0.72, 0.66); // from the target to the camera

// Throws if the browser has no WebGL 2. A browser that draws on the processor gets neither antialiasing nor more pixels
// than the page has: each costs as much as the picture.
function makeRenderer(): WebGLRenderer {
  const canvas = document.createElement('canvas');
  const open = (options: WebGLContextAttributes) => canvas.getContext('webgl2', { powerPreference: 'high-performance', ...options });
  const fast = open({ antialias: true, failIfMajorPerformanceCaveat: true }), context = fast ?? open({ antialias: false });
  if (!context) {
    throw new Error(typeof WebGL2RenderingContext === 'undefined' ? 'This browser has no WebGL 2.'
      : 'This browser refuses WebGL 2: hardware acceleration is switched off, or the graphics driver is on its block list.');
  }
  const renderer = new WebGLRenderer({ canvas, context });
  renderer.setPixelRatio(fast ? Math.min(window.devicePixelRatio || 1, 2) : 1);
  renderer.info.autoReset = false;
  return renderer;
}

export class Viewer {
  readonly canvas: HTMLCanvasElement;
  readonly look = new SurfaceLook();
  readonly marks: Mark[] = [];
  wipe = 0; // share of the width left of the divider
  onClasses: (classes: SurfaceClass[], has: Attributes) => void = () => {};
  onMove: () => void = () => {};
  onFrame: (triangles: number, loading: boolean) => void = () => {};
  onFault: (text: string) => void = () => {};
  private readonly renderer: WebGLRenderer;
  private readonly camera = new PerspectiveCamera(50, 1, 0.1, 1e5);
  private readonly controls: MapControls;
  private readonly sides: Partial<Record<'start' | 'result', { scene: Scene; set: TileSet }>> = {};
  private readonly lines = new LineSegments(new BufferGeometry(), new LineBasicMaterial({ color: 0xffd54a, depthTest: false, transparent: true }));
  private readonly cameraLines = new LineSegments(new BufferGeometry(), new LineBasicMaterial({ color: 0xff5a36 }));
  private readonly background = new Color();
  private readonly observer: ResizeObserver;
  readonly ready: Promise<void>; // the root of the result is known, and the camera has its place
  private onReady: () => void = () => {};
  private placed: boolean;
  private wanted = false;
  private closed = false;
  private drawn = { start: false, result: false }; // something of it has been seen
  private openStart: (() => void) | null = null; // null: there is none, or it is open
  private size = ''; // of the canvas
  private still: string = '';
  private readonly has: Attributes = { confidence: false, displacement: false, color: false };

  // Throws if the browser has no WebGL 2. `camera`: place and target, east-north-up; null: the whole result.
  constructor(private readonly holder: HTMLElement, result: TileSetAddress, start: TileSetAddress | null, camera: Vec[] | null) {
    this.renderer = makeRenderer();
    this.canvas = this.renderer.domElement;
    Object.assign(this.canvas, { tabIndex: 0 });
    this.canvas.style.visibility = 'hidden'; // black until something is drawn
    this.canvas.setAttribute('role', 'application');
    this.canvas.setAttribute('aria-label', 'The surface in 3D. Arrow keys move, Q and E turn, R and F tilt, + and − zoom, Enter reads the middle, Home shows everything.');
    holder.prepend(this.canvas);
    this.controls = new MapControls(this.camera, this.canvas);
    this.controls.enableDamping = !matchMedia('(prefers-reduced-motion: reduce)').matches;
    this.controls.dampingFactor = 0.15;
    this.controls.zoomToCursor = true;
    this.controls.maxPolarAngle = 0.49 * Math.PI;
    this.controls.addEventListener('change', () => this.invalidate());
    this.placed = camera !== null;
    this.ready = new Promise((resolve) => { this.onReady = resolve; });
    if (camera) {
      this.camera.position.copy(worldFromEnu(camera[0]));
      this.controls.target.copy(worldFromEnu(camera[1]));
    } else {
      this.camera.position.set(0, 500, 500); // until the root is known
    }
    this.resize();
    const on = {
      change: () => this.invalidate(),
      tile: (has: Attributes, classes: () => SurfaceClass[]) => this.addTile(has, classes),
      fault: (text: string) => this.onFault(text),
    };
    const open = (side: 'start' | 'result', address: TileSetAddress) => {
      const scene = new Scene();
      const set = new TileSet(address.url, address.transform, this.look, this.camera, this.renderer, on);
      scene.add(set.group);
      this.sides[side] = { scene, set };
    };
    open('result', result);
    // The start waits for the first picture of the result.
    if (start) this.openStart = () => open('start', start);
    this.lines.frustumCulled = this.cameraLines.frustumCulled = false;
    this.lines.renderOrder = 10;
    this.observer = new ResizeObserver(() => this.resize());
    this.observer.observe(holder);
    this.invalidate();
  }

  // Draws another picture soon.
  invalidate(): void {
    if (this.wanted || this.closed) return;
    this.wanted = true;
    requestAnimationFrame(() => this.frame());
  }

  setWipe(share: number): void {
    this.wipe = this.sides.start || this.openStart ? Math.min(Math.max(share, 0), 1) : 0;
    this.invalidate();
  }

  setMode(mode: ColorMode): void {
    this.look.setMode(mode);
    this.invalidate();
  }

  // Place and target of the camera, east-north-up.
  cameraNow(): Vec[] {
    return [enuFromWorld(this.camera.position), enuFromWorld(this.controls.target)];
  }

  // The surface at a point of the canvas, in pixels of the page; null: nothing there.
  pick(clientX: number, clientY: number): Hit | null {
    const box = this.canvas.getBoundingClientRect(), x = (clientX - box.left) / box.width, y = (clientY - box.top) / box.height;
    const side = x < this.wipe && this.drawn.start ? 'start' : 'result', shown = this.sides[side];
    if (!shown) return null;
    const ray = new Raycaster();
    ray.setFromCamera(new Vector2(2 * x - 1, 1 - 2 * y), this.camera);
    for (const hit of ray.intersectObject(shown.set.group, true)) {
      if (!hit.face) continue;
      const geometry = (hit.object as Mesh).geometry, { a, b, c } = hit.face;
      const classIndex = geometry.getAttribute('feature')?.getX(a) ?? 0;
      if (this.look.hidden.has(classIndex)) continue;
      const at = hit.barycoord ?? new Vector3(1 / 3, 1 / 3, 1 / 3);
      const value = (name: string) => {
        const attribute = geometry.getAttribute(name);
        return attribute ? at.x * attribute.getX(a) + at.y * attribute.getX(b) + at.z * attribute.getX(c) : null;
      };
      return { side, enu: enuFromWorld(hit.point), classIndex, confidence: value('confidence'), displacement: value('displacement') };
    }
    return null;
  }

  // Draws a line through these points, on top of the surface.
  setLine(points: Vec[]): void {
    const ends = points.slice(1).flatMap((point, i) => [points[i], point]);
    this.setSegments(this.lines, ends.map(worldFromEnu));
  }

  // Draws a pyramid for each camera: centre and direction.
  setCameras(cameras: { centre: Vec; direction: Vec }[], size_m: number): void {
    this.setSegments(this.cameraLines, cameras.flatMap(({ centre, direction }) => {
      const apex = worldFromEnu(centre), axis = worldFromEnu(direction).normalize();
      const right = new Vector3(0, 1, 0).cross(axis);
      if (right.lengthSq() < 1e-6) right.set(1, 0, 0);
      right.normalize();
      const up = axis.clone().cross(right), base = apex.clone().addScaledVector(axis, size_m);
      const corners = [[1, 1], [1, -1], [-1, -1], [-1, 1]].map(([i, j]) => base.clone().addScaledVector(right, 0.5 * i * size_m).addScaledVector(up, 0.375 * j * size_m));
      return corners.flatMap((corner, i) => [apex, corner, corner, corners[(i + 1) % 4]]);
    }));
  }

  // Moves the camera so that a sphere fills the view, from the south.
  show(centre: Vec, radius_m: number): void {
    const target = worldFromEnu(centre), distance = (radius_m * 1.05) / Math.tan((this.camera.fov * Math.PI) / 360) / Math.min(1, Math.max(0.4, this.camera.aspect));
    this.controls.target.copy(target);
    this.camera.position.copy(target).add(kFromSouth.clone().normalize().multiplyScalar(distance));
    this.controls.update();
    this.invalidate();
  }

  // Height of the middle of the result; 0: not known yet.
  get height_m(): number {
    const sphere = this.sphere();
    return sphere ? enuFromWorld(sphere.center)[2] : 0;
  }

  // Moves the camera so that the box of the result just fits into the view, from the south.
  showAll(): void {
    const corners = this.corners();
    if (!corners) return;
    const back = kFromSouth.clone().normalize(), right = new Vector3(0, 1, 0).cross(back).normalize(), up = back.clone().cross(right);
    const tan_y = kFilled * Math.tan((this.camera.fov * Math.PI) / 360), tan_x = tan_y * this.camera.aspect;
    const { x, y, distance } = fitCorners(corners.map((p) => [p.dot(right), p.dot(up), p.dot(back)]), tan_x, tan_y);
    this.camera.position.set(0, 0, 0).addScaledVector(right, x).addScaledVector(up, y).addScaledVector(back, distance);
    // The target is as deep in the view as the middle of the box.
    const depth = distance - corners.reduce((sum, p) => sum + p.dot(back), 0) / corners.length;
    this.controls.target.copy(this.camera.position).addScaledVector(back, -depth);
    this.controls.update();
    this.invalidate();
  }

  // Of the box of the result; null: not known yet.
  private corners(): Vector3[] | null {
    const set = this.sides.result?.set, box = new Box3(), matrix = new Matrix4();
    if (!set?.tiles.getOrientedBoundingBox(box, matrix)) return null;
    matrix.premultiply(set.group.matrix);
    return [0, 1, 2, 3, 4, 5, 6, 7].map((i) => new Vector3(i & 1 ? box.max.x : box.min.x, i & 2 ? box.max.y : box.min.y, i & 4 ? box.max.z : box.min.z).applyMatrix4(matrix));
  }

  // Turns by radians around the target, tilts, and changes the distance by a factor.
  orbit(turn: number, tilt: number, zoom: number): void {
    const offset = this.camera.position.clone().sub(this.controls.target), radius = offset.length() * zoom;
    const azimuth = Math.atan2(offset.x, offset.z) + turn;
    const polar = Math.min(Math.max(Math.acos(offset.y / offset.length()) + tilt, 0.02), 0.48 * Math.PI);
    offset.set(Math.sin(polar) * Math.sin(azimuth), Math.cos(polar), Math.sin(polar) * Math.cos(azimuth)).multiplyScalar(radius);
    this.camera.position.copy(this.controls.target).add(offset);
    this.controls.update();
    this.invalidate();
  }

  // Moves along the ground by shares of the distance: to the right, and forward.
  move(right: number, forward: number): void {
    const offset = this.camera.position.clone().sub(this.controls.target), distance = offset.length(), azimuth = Math.atan2(offset.x, offset.z);
    const step = new Vector3(Math.cos(azimuth) * right - Math.sin(azimuth) * forward, 0, -Math.sin(azimuth) * right - Math.cos(azimuth) * forward).multiplyScalar(distance);
    this.camera.position.add(step);
    this.controls.target.add(step);
    this.controls.update();
    this.invalidate();
  }

  close(): void {
    this.closed = true;
    this.observer.disconnect();
    this.controls.dispose();
    for (const side of Object.values(this.sides)) side.set.dispose();
    for (const lines of [this.lines, this.cameraLines]) {
      lines.geometry.dispose();
      (lines.material as LineBasicMaterial).dispose();
    }
    this.look.dispose();
    this.renderer.dispose();
    this.canvas.remove();
  }

  // The first tile has the table of classes; tiles of the start may lack what those of the result have.
  private addTile(has: Attributes, classes: () => SurfaceClass[]): void {
    const first = this.look.classes.length === 0;
    if (first) this.look.setClasses(classes());
    const more = (Object.keys(has) as (keyof Attributes)[]).filter((name) => has[name] && !this.has[name]);
    for (const name of more) this.has[name] = true;
    if (first || more.length > 0) this.onClasses(this.look.classes, this.has);
  }

  private setSegments(lines: LineSegments, points: Vector3[]): void {
    lines.geometry.dispose();
    lines.geometry = new BufferGeometry();
    // Relative to the first point: 32-bit floats.
    const origin = points[0] ?? new Vector3();
    lines.geometry.setAttribute('position', new BufferAttribute(new Float32Array(points.flatMap((p) => [p.x - origin.x, p.y - origin.y, p.z - origin.z])), 3));
    lines.position.copy(origin);
    lines.visible = points.length > 0;
    this.invalidate();
  }

  private sphere(): Sphere | null {
    const sphere = new Sphere(), set = this.sides.result?.set;
    if (!set?.tiles.getBoundingSphere(sphere)) return null;
    return sphere.applyMatrix4(set.group.matrix);
  }

  private resize(): void {
    const width = Math.max(1, this.holder.clientWidth), height = Math.max(1, this.holder.clientHeight);
    const size = `${width} x ${height}`;
    if (size === this.size) return;
    this.size = size;
    this.camera.aspect = width / height;
    this.camera.updateProjectionMatrix();
    this.renderer.setSize(width, height);
    for (const { set } of Object.values(this.sides)) set.tiles.setResolutionFromRenderer(this.camera, this.renderer);
    this.invalidate();
  }

  private frame(): void {
    this.wanted = false;
    if (this.closed) return;
    const sphere = this.sphere();
    if (!this.placed && sphere) {
      this.placed = true;
      this.showAll();
    }
    if (sphere) this.onReady();
    if (this.controls.update()) this.invalidate();
    const distance = this.camera.position.distanceTo(sphere?.center ?? this.controls.target), near = this.camera.position.distanceTo(this.controls.target);
    this.camera.near = Math.max(0.05, 0.01 * near);
    this.camera.far = distance + 2 * (sphere?.radius ?? 1e4) + 10 * near;
    this.camera.updateProjectionMatrix();
    this.camera.updateMatrixWorld();
    this.draw();
    this.moveMarks();
  }

  private draw(): void {
    const width = this.holder.clientWidth, height = this.holder.clientHeight, { start, result } = this.sides;
    for (const shown of [result, start]) shown?.set.tiles.update();
    const loading = (this.openStart !== null && this.wipe > 0) || [result, start].some((shown) => shown?.set.loading);
    // Nothing is drawn before there is something to see. Until the start is there, the result has the whole view.
    this.drawn.result ||= result?.set.visible === true;
    this.drawn.start ||= start?.set.visible === true;
    const divider = this.drawn.start ? Math.round(this.wipe * width) : 0;
    this.renderer.info.reset();
    if (this.drawn.result) {
      this.canvas.style.visibility = 'visible';
      this.background.set(getComputedStyle(this.holder).backgroundColor);
      this.renderer.setClearColor(this.background);
      this.renderer.setScissorTest(true);
      for (const [shown, from, to] of [[start, 0, divider], [result, divider, width]] as const) {
        if (!shown || to <= from) continue;
        this.renderer.setScissor(from, 0, to - from, height);
        shown.scene.add(this.lines, this.cameraLines);
        this.renderer.render(shown.scene, this.camera);
      }
      this.openStart?.();
      this.openStart = null;
    }
    const triangles = this.renderer.info.render.triangles;
    this.keepBudget(triangles, loading);
    this.onFrame(triangles, loading);
    const still = JSON.stringify(this.cameraNow().flat().map((x) => Math.round(10 * x)));
    if (still !== this.still) this.onMove();
    this.still = still;
  }

  // Allows a larger error while too many triangles are in view.
  private keepBudget(triangles: number, loading: boolean): void {
    for (const { set } of Object.values(this.sides)) {
      const target = set.tiles.errorTarget;
      if (triangles > 0.9 * kMaxTriangles) set.tiles.errorTarget = Math.min(64, target * 1.2);
      else if (!loading && triangles < 0.4 * kMaxTriangles && target > kErrorTarget_px) set.tiles.errorTarget = Math.max(kErrorTarget_px, target / 1.1);
      else continue;
      if (set.tiles.errorTarget !== target) this.invalidate();
    }
  }

  private moveMarks(): void {
    const width = this.holder.clientWidth, height = this.holder.clientHeight;
    for (const { enu, element } of this.marks) {
      const at = worldFromEnu(enu).project(this.camera);
      element.hidden = at.z > 1 || Math.abs(at.x) > 1 || Math.abs(at.y) > 1;
      element.style.transform = `translate(${((at.x + 1) / 2) * width}px, ${((1 - at.y) / 2) * height}px)`;
    }
  }
}

