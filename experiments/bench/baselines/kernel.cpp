// The closed loop on vectors of lanes, for cpp_kernel.py (model, sections 2 to 5).
//
// A lane is one run. The lanes of a vector share the deadline and tau; designs and seeds may differ. Positions are
// relative to the goal, a heading is its cosine and sine, and commands are kept per period: nu tau and omega tau.
//
// Built twice: for the AUC alone, by the trapezoid rule at the sampling instants, and with METRICS for all that qocjax
// computes of a run, its corrected rule for the AUC included.
#include <cmath>
#include <cstdint>
#include <cstring>
#include <vector>
#if defined(__AVX512F__)
#include <immintrin.h>
#endif

#ifndef LANES
#if defined(__AVX512F__)
#define LANES 16
#elif defined(__AVX__)
#define LANES 8
#else
#define LANES 4
#endif
#endif
#ifndef ROBOTS
#define ROBOTS 2
#endif
#ifndef METRICS
#define METRICS 0
#endif

namespace {

constexpr int N = ROBOTS;
constexpr bool ALL = METRICS;
typedef float Vec __attribute__((vector_size(4 * LANES)));
typedef std::int32_t Bits __attribute__((vector_size(4 * LANES)));

inline Vec fill(float a) { return a - Vec{}; }
inline Vec larger(Vec a, Vec b) { return a > b ? a : b; }
inline Vec smaller(Vec a, Vec b) { return a < b ? a : b; }
inline Vec magnitude(Vec a) { return (Vec)((Bits)a & INT32_MAX); }
inline Vec with_sign_of(Vec a, Vec sign) { return (Vec)((Bits)a | ((Bits)sign & INT32_MIN)); }  // for a >= 0

inline Vec inverse(Vec a) {
#if LANES == 16 && defined(__AVX512F__)
  const Vec guess = (Vec)_mm512_rcp14_ps((__m512)a);
  return guess + guess * (1.0f - a * guess);
#else
  return 1.0f / a;
#endif
}

inline Vec inverse_root(Vec a) {
#if LANES == 16 && defined(__AVX512F__)
  const Vec guess = (Vec)_mm512_rsqrt14_ps((__m512)a);
  return guess + 0.5f * guess * (1.0f - a * guess * guess);
#else
  Vec root;
  for (int l = 0; l < LANES; ++l) root[l] = std::sqrt(a[l]);
  return 1.0f / root;
#endif
}

// Angle of the vector (x, y): octant reduction, then the minimax polynomial of degree 15; error below 3e-7 rad.
inline Vec angle(Vec y, Vec x) {
  const Vec ax = magnitude(x), ay = magnitude(y);
  const Vec t = smaller(ax, ay) * inverse(larger(larger(ax, ay), fill(1e-30f)));
  const Vec q = t * t;
  Vec r = -0.00405456219f * q + 0.021862939f;
  r = r * q - 0.0559123009f;
  r = r * q + 0.096421957f;
  r = r * q - 0.139086291f;
  r = r * q + 0.199465662f;
  r = r * q - 0.333298594f;
  r = (r * q + 0.999999344f) * t;
  r = ay > ax ? 1.57079633f - r : r;
  r = x < 0.0f ? 3.14159265f - r : r;
  return with_sign_of(r, y);
}

struct Design {  // in the order of work.DESIGN
  Vec kappa, eta, gamma, c_miss, v_max, omega_max, d_safe;
};

struct Command {
  Vec length, turn;
};

struct Robot {
  Vec x, y, c, s;
  Command command;
  Vec born;      // tick of the command in force
  Vec sum[2];    // of the squared disagreement, per axis
};

struct Totals {  // what METRICS adds, of each robot
  Vec before;     // length per period of the motion that ends, times its duration squared, in periods
  Vec path;       // m
  Vec effort;     // of length and turn squared, in periods
  Vec last_away;  // last instant farther than 2 d_safe from the goal, -1 for none
  Vec age, peak;  // sum and maximum, in periods
  Vec completed;  // loops
};

// What does not depend on the design: one of these per set of seeds.
struct Seeds {
  int ids[LANES];
  std::vector<std::int32_t> times;  // [P][N][LANES] bits of the loop times: for floats of 0 or more they order alike
  std::vector<float> share;         // [P+1][LANES] distance left on the reference
  Vec offset[2];                    // where the reference starts
  Robot start[N];
};

struct Work {
  int vectors, ticks;
  float tau;
  float weights[2];
  const float *design;     // [vectors][7][LANES]
  const float *deadline;   // [vectors]
  const float *rest;       // [vectors] s
  const int *lag;          // [vectors]
  const int *seed;         // [vectors][LANES]
  const float *loop_times; // [S][P][N]
  const float *start;      // [S][N][3], relative to the goal
  const float *offset;     // [S][2], relative to the goal
  const float *share;      // [S][P+1]
  float *auc;              // [vectors][N][LANES]
  float *totals;           // [vectors][N][6][LANES]: path, effort, last_away, age, peak, completed; with METRICS
  float *closest;          // [vectors][LANES] smallest squared distance; with METRICS
};

template <class T> inline T load(const void *from) {
  T a;
  std::memcpy(&a, from, sizeof a);
  return a;
}

void gather(const Work &work, const int *ids, Seeds &seeds) {
  const int steps = work.ticks * N;
  std::memcpy(seeds.ids, ids, sizeof seeds.ids);
  seeds.times.resize(size_t(steps) * LANES);
  seeds.share.resize(size_t(work.ticks + 1) * LANES);
  const float *times[LANES], *share[LANES];
  for (int l = 0; l < LANES; ++l) {
    times[l] = work.loop_times + size_t(ids[l]) * steps;
    share[l] = work.share + size_t(ids[l]) * (work.ticks + 1);
    for (int k = 0; k < 2; ++k) seeds.offset[k][l] = work.offset[2 * ids[l] + k];
    for (int i = 0; i < N; ++i) {
      const float *pose = work.start + (size_t(ids[l]) * N + i) * 3;
      Robot &robot = seeds.start[i];
      robot.x[l] = pose[0], robot.y[l] = pose[1], robot.c[l] = std::cos(pose[2]), robot.s[l] = std::sin(pose[2]);
    }
  }
  for (int step = 0; step < steps; ++step)
    for (int l = 0; l < LANES; ++l) std::memcpy(&seeds.times[size_t(step) * LANES + l], times[l] + step, 4);
  for (int p = 0; p <= work.ticks; ++p)
    for (int l = 0; l < LANES; ++l) seeds.share[size_t(p) * LANES + l] = share[l][p];
}

// Design in units of a period, so that commands are nu tau and omega tau.
Design per_period(const float *from, float tau) {
  Design design = load<Design>(from);
  design.kappa *= tau, design.eta *= tau, design.gamma *= tau, design.v_max *= tau, design.omega_max *= tau;
  return design;
}

// Desired velocities times tau (Eqs. 4 to 6); `late` is t_p - deadline.
inline void desire(const Robot *robots, const Design &d, float late, float tau, Vec *vx, Vec *vy) {
  for (int i = 0; i < N; ++i) vx[i] = -d.kappa * robots[i].x, vy[i] = -d.kappa * robots[i].y;
  for (int i = 0; i < N; ++i)
    for (int j = i + 1; j < N; ++j) {
      const Robot &a = robots[i], &b = robots[j];
      const Vec dx = a.x - b.x, dy = a.y - b.y;
      const Vec near = inverse_root(larger(dx * dx + dy * dy, fill(1e-12f)));
      const Vec stale = larger(late - smaller(a.born, b.born) * tau, Vec{});
      const Vec excess = larger(near - inverse(d.d_safe + d.c_miss * stale), Vec{});
      const Vec force = (d.eta * excess) * near * (near * near);
      vx[i] += force * dx, vy[i] += force * dy;
      vx[j] -= force * dx, vy[j] -= force * dy;
    }
}

inline Command saturate(const Robot &r, const Design &d, Vec vx, Vec vy) {
  const Vec along = r.c * vx + r.s * vy, across = r.c * vy - r.s * vx;
  const Vec turn = d.gamma * angle(across, along);
  return {smaller(larger(along, Vec{}), d.v_max), smaller(larger(turn, -d.omega_max), d.omega_max)};
}

// Exact arc, by series good for turns of up to 0.5 rad: with S = sin(w)/w and C = (1 - cos(w))/w the chord is
// length (cS - sC, sS + cC), and the heading changes by w times the chord's direction, turned a quarter.
inline void arc(Robot &r, Vec length, Vec turn) {
  const Vec q = turn * turn;
  const Vec S = 1.0f - q * (1.0f / 6 - q * (1.0f / 120));
  const Vec C = turn * (0.5f - q * (1.0f / 24 - q * (1.0f / 720)));
  const Vec ux = r.c * S - r.s * C, uy = r.s * S + r.c * C;
  r.x += length * ux, r.y += length * uy;
  r.c -= turn * uy, r.s += turn * ux;
}

inline void tally(Robot &r, const Vec *offset, Vec share, float weight) {
  const Vec ex = r.x - offset[0] * share, ey = r.y - offset[1] * share;
  r.sum[0] += weight * (ex * ex), r.sum[1] += weight * (ey * ey);
}

// What an instant adds to the squared disagreement, over tau, where the motion changes: e (h e + d(h² v) / 6), with `bend`
// for the reference's part of d(h² v) / 6. `weight` is half of what both pieces last, `squared` the second's squared.
inline void tally_kink(Robot &r, Totals &t, const Vec *offset, Vec share, Vec bend, float weight, float squared) {
  const Vec ex = r.x - offset[0] * share, ey = r.y - offset[1] * share;
  const Vec after = squared * r.command.length, change = (1.0f / 6) * (after - t.before);
  r.sum[0] += ex * (weight * ex + (change * r.c - offset[0] * bend));
  r.sum[1] += ey * (weight * ey + (change * r.s - offset[1] * bend));
  t.before = after;
}

// What a motion of `part` of a period adds.
inline void tally_motion(Totals &t, const Command &command, float part) {
  t.path += part * magnitude(command.length);
  t.effort += part * (command.length * command.length + command.turn * command.turn);
}

// What is read at a sampling instant.
inline void tally_instant(const Robot *robots, Totals *totals, const Design &d, float p, Vec &closest) {
  for (int i = 0; i < N; ++i) {
    const Robot &r = robots[i];
    totals[i].last_away = r.x * r.x + r.y * r.y > 4.0f * d.d_safe * d.d_safe ? fill(p) : totals[i].last_away;
    for (int j = i + 1; j < N; ++j) {
      const Vec dx = r.x - robots[j].x, dy = r.y - robots[j].y;
      closest = smaller(closest, dx * dx + dy * dy);
    }
  }
}

// When, within a tick, a command takes effect.
enum Change { AT_BEGINNING, INSIDE, AT_END };

template <Change change> void run(const Work &work, int vector, const Seeds &seeds, std::vector<Command> &ring) {
  const float tau = work.tau, deadline = work.deadline[vector], part = work.rest[vector] / tau;
  const Bits limit = (Bits)fill(deadline);
  const int lag = work.lag[vector], depth = lag + 1;
  const Design design = per_period(work.design + size_t(vector) * 7 * LANES, tau);
  ring.resize(size_t(depth) * N);
  Robot robots[N];
  std::memcpy(robots, seeds.start, sizeof robots);
  Totals totals[N] = {};
  for (Totals &t : totals) t.last_away = fill(-1.0f);
  Vec closest = fill(INFINITY);
  Vec initial[N];
  for (int i = 0; i < N; ++i) {
    tally(robots[i], seeds.offset, load<Vec>(seeds.share.data()), 1.0f);
    initial[i] = work.weights[0] * robots[i].sum[0] + work.weights[1] * robots[i].sum[1];
    const float beyond = ALL && change == INSIDE ? -0.5f * (1 - part) : -0.5f;  // what the loop counts too much of
    robots[i].sum[0] *= beyond, robots[i].sum[1] *= beyond;                     // the first instant
  }
  int newest = 0;
  for (int p = 0; p < work.ticks; ++p) {
    const Vec share = load<Vec>(&seeds.share[size_t(p) * LANES]);
    Vec drawn = {}, bend = {}, inside = {};
    if (ALL) {
      drawn = load<Vec>(&seeds.share[size_t(p + 1) * LANES]) - share;  // straight over a tick
      const Vec earlier = p ? share - load<Vec>(&seeds.share[size_t(p - 1) * LANES]) : Vec{};
      const float last = change == INSIDE ? 1 - part : 1, first = change == INSIDE ? part : 1;
      bend = (1.0f / 6) * (first * first * drawn - last * last * earlier);
      inside = (1.0f / 6) * (last * last - first * first) * drawn;
      tally_instant(robots, totals, design, p, closest);
    }
    Vec vx[N], vy[N];
    desire(robots, design, p * tau - deadline, tau, vx, vy);
    for (int i = 0; i < N; ++i) ring[newest * N + i] = saturate(robots[i], design, vx[i], vy[i]);
    newest = newest + 1 == depth ? 0 : newest + 1;  // now also the oldest: that of tick p - lag
    const int loop = p - lag;
    for (int i = 0; i < N; ++i) {
      Robot &r = robots[i];
      Totals &t = totals[i];
      if (!ALL) tally(r, seeds.offset, share, 1.0f);
      if (ALL) {
        const Vec age = float(p) - r.born;
        t.age += age, t.peak = larger(t.peak, age);
        t.completed += load<Bits>(&seeds.times[(size_t(p) * N + i) * LANES]) <= limit ? fill(1.0f) : Vec{};
        const float weight = change == INSIDE ? 0.5f : 1.0f;  // of an instant at t_p
        if (change != AT_BEGINNING) tally_kink(r, t, seeds.offset, share, bend, weight, change == INSIDE ? part * part : 1);
        if (change == INSIDE) tally_motion(t, r.command, part);
        if (change == AT_END) tally_motion(t, r.command, 1);
      }
      if (change == INSIDE) arc(r, r.command.length * part, r.command.turn * part);
      if (change == AT_END) arc(r, r.command.length, r.command.turn);
      if (loop >= 0) {
        const Bits done = load<Bits>(&seeds.times[(size_t(loop) * N + i) * LANES]) <= limit;
        const Command &sent = ring[newest * N + i];
        r.command = {done ? sent.length : r.command.length, done ? sent.turn : r.command.turn};
        r.born = done ? fill(float(loop)) : r.born;
      }
      if (ALL && change == INSIDE) {
        tally_kink(r, t, seeds.offset, share + part * drawn, inside, 0.5f, (1 - part) * (1 - part));
        tally_motion(t, r.command, 1 - part);
      }
      if (ALL && change == AT_BEGINNING) {
        tally_kink(r, t, seeds.offset, share, bend, 1.0f, 1);
        tally_motion(t, r.command, 1);
      }
      if (change == INSIDE) arc(r, r.command.length * (1 - part), r.command.turn * (1 - part));
      if (change == AT_BEGINNING) arc(r, r.command.length, r.command.turn);
    }
  }
  const Vec end = load<Vec>(&seeds.share[size_t(work.ticks) * LANES]);
  if (ALL) {
    const float last = change == INSIDE ? 1 - part : 1;
    const Vec bend = (-1.0f / 6) * last * last * (end - load<Vec>(&seeds.share[size_t(work.ticks - 1) * LANES]));
    tally_instant(robots, totals, design, work.ticks, closest);
    for (int i = 0; i < N; ++i) tally_kink(robots[i], totals[i], seeds.offset, end, bend, 0.5f * last, 0.0f);
    std::memcpy(work.closest + size_t(vector) * LANES, &closest, sizeof closest);
    for (int i = 0; i < N; ++i)  // all but `before`
      std::memcpy(work.totals + (size_t(vector) * N + i) * 6 * LANES, &totals[i].path, 6 * sizeof(Vec));
  }
  for (int i = 0; i < N; ++i) {
    if (!ALL) tally(robots[i], seeds.offset, end, 0.5f);
    const Vec sum = work.weights[0] * robots[i].sum[0] + work.weights[1] * robots[i].sum[1];
    const Vec auc = tau * sum / initial[i];
    std::memcpy(work.auc + (size_t(vector) * N + i) * LANES, &auc, sizeof auc);
  }
}

}  // namespace

extern "C" int lanes() { return LANES; }

extern "C" void evaluate(const Work *work) {
#pragma omp parallel
  {
    Seeds seeds{};
    seeds.ids[0] = -1;
    std::vector<Command> ring;
#pragma omp for schedule(dynamic, 4)
    for (int v = 0; v < work->vectors; ++v) {
      const int *ids = work->seed + size_t(v) * LANES;
      if (std::memcmp(ids, seeds.ids, sizeof seeds.ids)) gather(*work, ids, seeds);
      if (work->rest[v] == work->tau) run<AT_END>(*work, v, seeds, ring);
      else if (work->rest[v] > 0) run<INSIDE>(*work, v, seeds, ring);
      else run<AT_BEGINNING>(*work, v, seeds, ring);
    }
  }
}
