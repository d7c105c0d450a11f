// Trajectory field (Eqs. 9-10) and the embedded trajectories: the twin of sumo_eval/method/trajectory_field.py, and the
// other half of `encode_trajectories` in sumo_eval/report/sent_drives.py. Tests run this file in node against them.
"use strict";

const sumoEval = (() => {
  const COINCIDENT = 1e-9; // m; nearer than this a direction is only the rounding of the coordinates
  const SAME_TIME = 1e-6; // s

  /** Eq. 9 at points: {x, y} arrays of m. trajectory: time s, x m, y m, heading rad, speed m/s. Returns Float64Array. */
  function trajectoryField(points, trajectory, { k1, k2, sample_interval: sampleInterval, superposition }) {
    const motion = resampled(trajectory, sampleInterval);
    const field = new Float64Array(points.x.length);
    const alongX = motion.heading.map((heading, j) => k2 * motion.speed[j] * Math.cos(heading));
    const alongY = motion.heading.map((heading, j) => k2 * motion.speed[j] * Math.sin(heading));
    for (let i = 0; i < field.length; i++) {
      let total = 0, sumX = 0, sumY = 0;
      for (let j = 0; j < motion.x.length; j++) {
        const dx = points.x[i] - motion.x[j], dy = points.y[i] - motion.y[j];
        const distance = Math.sqrt(dx * dx + dy * dy);
        const apart = distance > COINCIDENT;
        const exponent = apart ? (alongX[j] * dx + alongY[j] * dy) / distance : k2 * motion.speed[j];
        const reach = Math.max(distance, 1);
        const size = Math.exp(exponent) / (k1 === 0.5 ? Math.sqrt(reach) : Math.pow(reach, k1));
        total += size;
        if (apart) {
          sumX += size * dx / distance;
          sumY += size * dy / distance;
        }
      }
      field[i] = superposition === "vector" ? Math.hypot(sumX, sumY) : total;
    }
    return field;
  }

  /** x, y, heading, speed at exactly `interval` steps from the first time; as it is where it already is sampled so. */
  function resampled(trajectory, interval) {
    const time = trajectory.time, last = time.length - 1;
    const count = Math.floor((time[last] - time[0] + SAME_TIME) / interval) + 1;
    const times = Float64Array.from({ length: count }, (_, j) => time[0] + interval * j);
    if (count === time.length && times.every((t, j) => Math.abs(t - time[j]) <= SAME_TIME)) return trajectory;
    const channels = { x: trajectory.x, y: trajectory.y, heading: unwrapped(trajectory.heading), speed: trajectory.speed };
    const motion = {};
    for (const [name, values] of Object.entries(channels)) motion[name] = times.map((t) => at(time, values, t));
    return motion;
  }

  /** A channel at a time, linear between samples, constant beyond the ends. */
  function at(time, values, t) {
    let low = 0, high = time.length - 1;
    if (t <= time[low]) return values[low];
    if (t >= time[high]) return values[high];
    while (high - low > 1) {
      const middle = (low + high) >> 1;
      if (time[middle] <= t) low = middle; else high = middle;
    }
    return values[low] + (values[high] - values[low]) * (t - time[low]) / (time[high] - time[low]);
  }

  function unwrapped(angles) {
    const result = Float64Array.from(angles);
    for (let j = 1; j < result.length; j++) {
      result[j] -= 2 * Math.PI * Math.round((result[j] - result[j - 1]) / (2 * Math.PI));
    }
    return result;
  }

  function bytes(base64) {
    const text = atob(base64);
    const result = new Uint8Array(text.length);
    for (let i = 0; i < text.length; i++) result[i] = text.charCodeAt(i);
    return result;
  }

  /** What `packed` in sumo_eval/report/page.py made of a text. */
  async function inflated(base64) {
    const stream = new Blob([bytes(base64)]).stream().pipeThrough(new DecompressionStream("deflate"));
    return new Response(stream).text();
  }

  /** What `encode_trajectories` packed: an array of {time, x, y, heading, speed, ..., length, width}. A channel that was
   *  not known in a trajectory is NaN throughout; samples that the differences cannot hold are those of `beyond`. */
  async function decodeTrajectories(packed, channels) {
    const inflated = new Blob([bytes(packed.data)]).stream().pipeThrough(new DecompressionStream("deflate"));
    const planes = new Uint8Array(await new Response(inflated).arrayBuffer());
    const n = packed.counts.reduce((sum, count) => sum + count, 0);
    const decoded = {};
    Object.entries(channels).forEach(([name, step], index) => {
      const values = new Float64Array(n), base = index * 4 * n, perUnit = Math.round(1 / step);
      let whole = 0;
      for (let i = 0; i < n; i++) {
        const folded = (planes[base + i] | planes[base + n + i] << 8 | planes[base + 2 * n + i] << 16 |
          planes[base + 3 * n + i] << 24) >>> 0;
        whole += folded % 2 ? -(folded + 1) / 2 : folded / 2;
        values[i] = whole / perUnit;
      }
      decoded[name] = values;
    });
    for (const [name, place, count, value] of packed.beyond) decoded[name].fill(value, place, place + count);
    let begin = 0;
    return packed.counts.map((count, index) => {
      const trajectory = { length: packed.lengths[index], width: packed.widths[index] };
      for (const name of Object.keys(channels)) trajectory[name] = decoded[name].subarray(begin, begin + count);
      if (packed.noSteering.includes(index)) trajectory.steering_wheel_angle = new Float64Array(count).fill(NaN);
      begin += count;
      return trajectory;
    });
  }

  /** Levels of a zone map, as `zone_levels` in sumo_eval/scoring/zone_levels.py packs them: Int16Array of 32000 y. */
  function decodeLevels(base64) {
    const raw = bytes(base64);
    const view = new DataView(raw.buffer);
    return Int16Array.from({ length: raw.length / 2 }, (_, i) => view.getInt16(2 * i, true));
  }

  return { trajectoryField, decodeTrajectories, decodeLevels, inflated, at };
})();

if (typeof module !== "undefined") module.exports = sumoEval;
