// Decides how much is drawn while the scene moves, from the time that the last frames took.

const SLOW_MILLISECONDS = 30;
const FAST_MILLISECONDS = 20;
const LEAST_DETAIL = 0.01;
// Below this detail, frustums are drawn coarsely and ellipsoids are left out.
const COARSE_BELOW = 0.6;

export class LevelOfDetail {
  // The part of the points that is drawn in motion.
  detail = 1;
  // Mean time between frames of a motion, which includes the work of the graphics card.
  milliseconds = 0;
  private last = -1;

  get isCoarse(): boolean {
    return this.detail < COARSE_BELOW;
  }

  // Takes the time at which a frame of a motion begins.
  frame(now: number): void {
    const elapsed = now - this.last;
    const isFirst = this.last < 0;
    this.last = now;
    if (isFirst || elapsed <= 0) return;
    this.milliseconds = this.milliseconds === 0 ? elapsed : 0.7 * this.milliseconds + 0.3 * elapsed;
    if (elapsed > SLOW_MILLISECONDS) this.detail *= Math.max(0.5, SLOW_MILLISECONDS / elapsed);
    else if (elapsed < FAST_MILLISECONDS) this.detail *= 1.1;
    this.detail = Math.min(1, Math.max(LEAST_DETAIL, this.detail));
  }

  // Takes the time of a complete frame at rest, from which the next motion knows how much it can draw.
  complete(milliseconds: number): void {
    if (milliseconds > SLOW_MILLISECONDS) this.detail = Math.max(LEAST_DETAIL, SLOW_MILLISECONDS / milliseconds);
  }

  // Ends a motion: the pause until the next one says nothing about the time of a frame.
  rest(): void {
    this.last = -1;
  }
}
