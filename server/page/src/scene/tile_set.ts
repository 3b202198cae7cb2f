// A tile set of the start or of the result, moved so that its east-north-up frame is that of the drawing.
import { type BufferGeometry, type Group, Matrix4, type Mesh, type Object3D, type PerspectiveCamera, type WebGLRenderer } from 'three';
import { TilesRenderer } from '3d-tiles-renderer/three';
import { GLTFExtensionsPlugin } from '3d-tiles-renderer/src/three/plugins/GLTFExtensionsPlugin.js';
import { takeFile } from '../api/early';
import type { SurfaceClass, SurfaceLook } from './surface_material';

export interface Attributes { confidence: boolean; displacement: boolean; color: boolean }

const kYUpFromEnu = new Matrix4().set(1, 0, 0, 0, 0, 0, 1, 0, 0, -1, 0, 0, 0, 0, 0, 1);

export class TileSet {
  readonly tiles: TilesRenderer;
  readonly group: Group;
  private failures = 0;

  // `on.change`: another picture is needed. `tile`: a tile was read; what its vertices
  // have, and its table of classes. `fault`: a file could not be read.
  constructor(url: string, transform: number[] | null, private readonly look: SurfaceLook, camera: PerspectiveCamera,
              renderer: WebGLRenderer, on: { change(): void; tile(has: Attributes, classes: () => SurfaceClass[]): void; fault(text: string): void }) {
    this.tiles = new TilesRenderer(url);
    this.tiles.fetchOptions = { credentials: 'same-origin' };
    this.tiles.registerPlugin({
      fetchData: async (file: string, options: RequestInit) => await takeFile(file) ?? fetch(file, options),
    } as object);
    this.tiles.registerPlugin(new GLTFExtensionsPlugin({ metadata: true, rtc: false, autoDispose: false } as object));
    this.tiles.lruCache.minBytesSize = 200e6;
    this.tiles.lruCache.maxBytesSize = 400e6;
    this.group = this.tiles.group;
    this.group.matrixAutoUpdate = false;
    this.group.matrix.copy(kYUpFromEnu);
    if (transform) this.group.matrix.multiply(new Matrix4().fromArray(transform).invert());
    this.group.updateMatrixWorld(true);
    this.tiles.setCamera(camera);
    this.tiles.setResolutionFromRenderer(camera, renderer);
    for (const event of ['needs-update', 'load-tileset', 'tile-visibility-change', 'tiles-load-end']) {
      this.tiles.addEventListener(event, on.change);
    }
    this.tiles.addEventListener('load-model', (event: { scene: Object3D }) => {
      this.dress(event.scene, on.tile);
      on.change();
    });
    this.tiles.addEventListener('load-error', (event: { error: Error; url: string | URL }) => {
      if (++this.failures === 1) on.fault(`A file of the tile set cannot be read: ${String(event.url).split('/').slice(-3).join('/')}: ${event.error.message}`);
    });
  }

  get loading(): boolean {
    const stats = (this.tiles as unknown as { stats: Record<string, number> }).stats;
    return !this.tiles.root || stats['queued'] + stats['downloading'] + stats['parsing'] > 0;
  }

  // Whether a picture shows something of it.
  get visible(): boolean {
    return this.tiles.visibleTiles.size > 0;
  }

  dispose(): void {
    this.tiles.dispose();
  }

  private dress(model: Object3D, onTile: (has: Attributes, classes: () => SurfaceClass[]) => void): void {
    model.traverse((object) => {
      const mesh = object as Mesh;
      if (!mesh.isMesh) return;
      const geometry = mesh.geometry as BufferGeometry;
      const names: [string, string][] = [['_feature_id_0', 'feature'], ['_confidence', 'confidence'], ['_displacement', 'displacement'], ['color', 'tint']];
      for (const [from, to] of names) {
        const attribute = geometry.getAttribute(from);
        if (!attribute) continue;
        geometry.setAttribute(to, attribute);
        geometry.deleteAttribute(from);
      }
      mesh.material = geometry.getAttribute('normal') ? this.look.lit : this.look.unlit;
      const has = { confidence: geometry.hasAttribute('confidence'), displacement: geometry.hasAttribute('displacement'), color: geometry.hasAttribute('tint') };
      onTile(has, () => this.classesOf(mesh));
    });
  }

  // The rows of the table of classes (EXT_structural_metadata).
  private classesOf(mesh: Mesh): SurfaceClass[] {
    const metadata = mesh.userData['structuralMetadata'], features = mesh.userData['meshFeatures'];
    const count: number = features?.getFeatureInfo?.()?.[0]?.featureCount ?? 0;
    const classes: SurfaceClass[] = [];
    for (let i = 0; i < count; ++i) {
      const row = metadata?.getPropertyTableData(0, i) ?? {};
      const color = row.color;
      classes.push({
        name: String(row.name ?? `class ${i}`), asprs: Number(row.asprs ?? 0),
        color: color ? [color.x ?? color[0], color.y ?? color[1], color.z ?? color[2]] : [160, 160, 160],
      });
    }
    return classes;
  }
}
