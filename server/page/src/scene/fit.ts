// Where a camera must be to see a whole box.
export type Vec = [number, number, number];

export interface Placement { x: number; y: number; distance: number }

// `corners`: of the box, in the axes of the camera (right, up, back) from any origin. `tan_x`, `tan_y`: of half of the
// angles of view. The nearest place from which all corners are in view: (x, y, distance) in the same axes. Each
// corner bounds it by two planes a direction, so the widest pair of planes decides.
export function fitCorners(corners: Vec[], tan_x: number, tan_y: number): Placement {
  const along = (k: 0 | 1, tan: number) => {
    const high = Math.max(...corners.map((p) => p[k] + tan * p[2])), low = Math.min(...corners.map((p) => p[k] - tan * p[2]));
    return { middle: (high + low) / 2, distance: (high - low) / (2 * tan) };
  };
  const x = along(0, tan_x), y = along(1, tan_y);
  return { x: x.middle, y: y.middle, distance: Math.max(x.distance, y.distance) };
}
