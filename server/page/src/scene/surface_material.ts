// The material of all tiles: colours by class, file colours, confidence or displacement; classes can be hidden.
import { DataTexture, DoubleSide, NearestFilter, RGBAFormat, ShaderMaterial, Vector3 } from 'three';

export type ColorMode = 'class' | 'file' | 'confidence' | 'displacement';
export const kColorModes: ColorMode[] = ['class', 'file', 'confidence', 'displacement'];

export interface SurfaceClass { name: string; color: [number, number, number]; asprs: number }

const kRows = 256; // classes that the table can hold

const kVertex = /* glsl */`
  attribute float feature;
  attribute float confidence;
  attribute float displacement;
  attribute vec4 tint;
  flat varying float vFeature;
  varying float vConfidence;
  varying float vDisplacement;
  varying vec3 vTint;
  varying vec3 vNormal;
  void main() {
    vFeature = feature;
    vConfidence = confidence;
    vDisplacement = displacement;
    vTint = tint.rgb;
    vNormal = normalize(mat3(modelMatrix) * normal);
    gl_Position = projectionMatrix * modelViewMatrix * vec4(position, 1.0);
  }`;

const kFragment = /* glsl */`
  uniform sampler2D classes;
  uniform int mode;
  uniform bool lit;
  uniform float largest;
  flat varying float vFeature;
  varying float vConfidence;
  varying float vDisplacement;
  varying vec3 vTint;
  varying vec3 vNormal;
  vec3 toLinear(vec3 c) {
    return mix(c / 12.92, pow((c + 0.055) / 1.055, vec3(2.4)), step(0.04045, c));
  }
  // A polynomial fit of matplotlib's viridis (Matt Zucker, public domain).
  vec3 viridis(float t) {
    const vec3 c0 = vec3(0.2777273, 0.0054073, 0.3340998), c1 = vec3(0.1050930, 1.4046135, 1.3845902),
      c2 = vec3(-0.3308618, 0.2148476, 0.0950952), c3 = vec3(-4.6342305, -5.7991010, -19.3324410),
      c4 = vec3(6.2282700, 14.1799334, 56.6905526), c5 = vec3(4.7763850, -13.7451454, -65.3530326),
      c6 = vec3(-5.4354559, 4.6458526, 26.3124352);
    return c0 + t * (c1 + t * (c2 + t * (c3 + t * (c4 + t * (c5 + t * c6)))));
  }
  void main() {
    vec4 row = texelFetch(classes, ivec2(int(min(vFeature + 0.5, 255.0)), 0), 0);
    if (row.a < 0.5) discard;
    vec3 color;
    if (mode == 0) color = toLinear(row.rgb);
    else if (mode == 1) color = vTint;
    else if (mode == 2) color = toLinear(clamp(viridis(clamp(vConfidence, 0.0, 1.0)), 0.0, 1.0));
    else {
      float t = clamp(vDisplacement / largest, 0.0, 1.0);
      color = toLinear(mix(vec3(1.0, 0.96, 0.72), mix(vec3(0.99, 0.55, 0.24), vec3(0.50, 0.0, 0.15), clamp(2.0 * t - 1.0, 0.0, 1.0)), clamp(2.0 * t, 0.0, 1.0)));
    }
    if (lit) {
      vec3 n = gl_FrontFacing ? vNormal : -vNormal;
      float light = 0.42 + 0.18 * n.y + 0.55 * max(dot(n, normalize(vec3(0.45, 0.75, 0.5))), 0.0);
      color *= light;
    }
    gl_FragColor = vec4(color, 1.0);
    #include <colorspace_fragment>
  }`;

export class SurfaceLook {
  private readonly rows = new Uint8Array(4 * kRows).fill(255);
  private readonly texture = new DataTexture(this.rows, kRows, 1, RGBAFormat);
  private readonly shared = { classes: { value: this.texture }, mode: { value: 0 }, largest: { value: 1 } };
  readonly lit = this.material(true);
  readonly unlit = this.material(false); // of tiles without normals
  classes: SurfaceClass[] = [];
  readonly hidden = new Set<number>();

  constructor() {
    this.texture.magFilter = this.texture.minFilter = NearestFilter;
    this.texture.needsUpdate = true;
  }

  setClasses(classes: SurfaceClass[]): void {
    this.classes = classes;
    this.write();
  }

  setVisible(index: number, visible: boolean): void {
    if (visible) this.hidden.delete(index);
    else this.hidden.add(index);
    this.write();
  }

  setMode(mode: ColorMode): void {
    this.shared.mode.value = kColorModes.indexOf(mode);
  }

  // Displacements from this length on have the last colour.
  setLargestDisplacement(length_m: number): void {
    this.shared.largest.value = length_m;
  }

  dispose(): void {
    this.texture.dispose();
    this.lit.dispose();
    this.unlit.dispose();
  }

  private write(): void {
    this.classes.slice(0, kRows).forEach(({ color }, i) => {
      this.rows.set([...color, this.hidden.has(i) ? 0 : 255], 4 * i);
    });
    this.texture.needsUpdate = true;
  }

  private material(lit: boolean): ShaderMaterial {
    return new ShaderMaterial({
      vertexShader: kVertex, fragmentShader: kFragment, side: DoubleSide,
      uniforms: { ...this.shared, lit: { value: lit } },
    });
  }
}

export function cssColor([r, g, b]: [number, number, number]): string {
  return `rgb(${r}, ${g}, ${b})`;
}

// The point of a local east-north-up frame in the drawing, where y is up.
export function worldFromEnu([e, n, u]: [number, number, number]): Vector3 {
  return new Vector3(e, u, -n);
}

export function enuFromWorld({ x, y, z }: Vector3): [number, number, number] {
  return [x, -z, y];
}
