// SPDX-License-Identifier: Apache-2.0
// How many strands are asked for. While something moves: as many as give the wanted rate of new frames, in steps of sqrt(2). A step up
// needs room for it and is not tried again soon after it has failed, so that the number settles. At rest: all, at once if that takes a
// moment, else after a longer stillness, so that the program is free for the next change.
const step = Math.SQRT2;
const window_ms = 350, min_frames = 3, max_window_ms = 1500;   // of a measurement of the rate
const rest_ms = 350, long_rest_ms = 2500;   // stillness until more, until all strands are asked for
const moment_ms = 1500;         // an answer that takes longer waits for the long rest
const retry_ms = 8000;          // after a step up that failed
const min_strands = 4000, start_strands = 20000, first_strands = 5000;   // first: of the first frame of a scene
const min_gain = 1.04;          // of the rate by a step down; less: strands are not what takes the time
const fixed_share = 1.25;       // of the time that does not depend on the strands, as much is accepted

export class Budget {
  constructor() {
    this.now = start_strands;
    this.full = 200000;
    this.rate = 12;
    this.touched = -Infinity;
    this.failed = {strands: Infinity, time: -Infinity};
    this.raised = this.hold = -Infinity;
    this.moving = false;
    this.before = null;         // the newest step down: {strands, rate, steps, time}
    this.last = this.other = null;   // {strands, ms}: the program's newest time, and that for another number of strands
    this.total = 0;
    this.restart();
  }
  restart() {
    this.times = [];
    this.since = null;
    this.slow = this.fast = 0;
    this.skip = 2;   // the first frames of a new number of strands are slower than the rest
  }
  touch(now) { this.touched = now; }

  // The program took `ms` for `strands`.
  answered(strands, ms) {
    if (this.last && Math.abs(Math.log(this.last.strands / strands)) > 0.3) this.other = this.last;
    const same = this.last && this.other !== this.last;
    this.last = {strands, ms: same ? this.last.ms + 0.5 * (ms - this.last.ms) : ms};
    const allowed = 1000 / this.reachable();
    if (this.moving && ms > 2.5 * allowed) {
      const [fixed, each] = this.cost();
      const fit = each > 0 ? (allowed - fixed) / each : this.now;
      if (fit < this.now / 1.3) this.change(Math.max(min_strands, fit));
    }
  }
  // [time that does not depend on the strands, time of one more], from the two newest numbers of strands.
  cost() {
    const {last, other} = this;
    if (!last) return [0, 0];
    if (!other) return [0, last.ms / last.strands];
    const each = Math.max(0, (last.ms - other.ms) / (last.strands - other.strands));
    return [Math.max(0, last.ms - each * last.strands), each];
  }
  // The rate that can be had by showing fewer strands, at most the wanted one.
  reachable() { return Math.min(this.rate, 1000 / Math.max(1, fixed_share * this.cost()[0])); }

  strands(now, playing, first) {
    if (first) return Math.min(first_strands, this.full);
    const still = now - this.touched, moving = playing || still < rest_ms;
    if (moving !== this.moving) { this.moving = moving; this.restart(); }
    if (moving) return Math.round(Math.min(this.now, this.full));
    const [fixed, each] = this.cost();
    if (still > long_rest_ms || fixed + each * this.full < moment_ms) return this.full;
    return Math.round(Math.min(this.full, Math.max(this.now, this.last ? this.last.strands : 0)));
  }
  // A picture was drawn, of the frames-th frame that came.
  drawn(now, frames) {
    if (frames === this.counted) return;
    this.counted = frames;
    ++this.total;
    this.times.push(now);
    if (this.times.length > 200) this.times.splice(0, 100);
  }
  rate_now() {
    const now = performance.now(), times = this.times, recent = times.filter(time => now - time < 1500);
    let rate = 0;
    if (recent.length > 2) rate = 1000 * (recent.length - 1) / (recent[recent.length - 1] - recent[0]);
    else if (times.length > 1) rate = 1000 / Math.max(now - times[times.length - 1], times[times.length - 1] - times[times.length - 2]);
    return rate < 9.95 ? Number(rate.toFixed(1)) : Math.round(rate);
  }
  measure(now, playing) {
    if (!playing) return;
    const again = () => { this.since = now; this.from = this.total; };
    if (this.since === null) { again(); return; }
    const passed = now - this.since, count = this.total - this.from;
    if (this.skip > 0) {
      if (count > 0) { --this.skip; again(); }
      return;
    }
    const wanted = this.reachable();
    if (passed < window_ms || (count < min_frames && passed < Math.max(max_window_ms, 3000 / wanted))) return;
    again();
    this.steer(now, 1000 * count / passed, wanted);
  }
  steer(now, rate, wanted) {
    this.slow = rate < 0.92 * wanted ? this.slow + 1 : 0;
    // Nothing comes faster than the screen's 60 a second.
    const [fixed, each] = this.cost(), room = wanted < this.rate && rate > wanted && fixed + each * step * this.now < 1000 / wanted;
    this.fast = rate > Math.min(1.6 * wanted, 0.93 * 60) || room ? this.fast + 1 : 0;
    if (this.slow >= 2 || rate < 0.6 * wanted) {
      if (now - this.raised < 4000) this.failed = {strands: this.now, time: now};
      // Fewer strands that bring nothing are given back.
      if (this.before && now - this.before.time < 6000 && rate < this.before.rate * min_gain ** this.before.steps) {
        const back = this.before.strands;
        this.before = null;
        this.hold = now + retry_ms;
        this.change(back);
        return;
      }
      if (now < this.hold) return;
      const steps = Math.max(1, Math.min(4, Math.round(Math.log(wanted / Math.max(rate, 0.1)) / Math.log(step))));
      this.before = {strands: this.now, rate, steps, time: now};
      this.change(Math.max(min_strands, this.now / step ** steps));
    } else if (this.fast >= 2 && this.now < this.full) {
      const next = Math.min(this.full, this.now * step);
      if (next >= this.failed.strands * 0.99 && now - this.failed.time < retry_ms) return;
      this.raised = now;
      this.change(next);
    }
  }
  change(strands) {
    if (strands === this.now) return;
    this.now = strands;
    this.restart();
  }
}
