// The closed loop on vectors of lanes, for cpp_kernel.py (model, sections 2 to 5).
//
// A lane is one run. The lanes of a vector share the deadline and tau; designs and seeds may differ. Positions are
// relative to the goal, a heading is its cosine and sine, and commands are kept per period: nu tau and omega tau.
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

namespace {

constexpr int N = ROBOTS;
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
  Vec initial[N];
  for (int i = 0; i < N; ++i) {
    tally(robots[i], seeds.offset, load<Vec>(seeds.share.data()), 1.0f);
    initial[i] = work.weights[0] * robots[i].sum[0] + work.weights[1] * robots[i].sum[1];
    robots[i].sum[0] *= -0.5f, robots[i].sum[1] *= -0.5f;  // the loop counts the first instant in full
  }
  int newest = 0;
  for (int p = 0; p < work.ticks; ++p) {
    const Vec share = load<Vec>(&seeds.share[size_t(p) * LANES]);
    Vec vx[N], vy[N];
    desire(robots, design, p * tau - deadline, tau, vx, vy);
    for (int i = 0; i < N; ++i) ring[newest * N + i] = saturate(robots[i], design, vx[i], vy[i]);
    newest = newest + 1 == depth ? 0 : newest + 1;  // now also the oldest: that of tick p - lag
    const int loop = p - lag;
    for (int i = 0; i < N; ++i) {
      Robot &r = robots[i];
      tally(r, seeds.offset, share, 1.0f);
      if (change == INSIDE) arc(r, r.command.length * part, r.command.turn * part);
      if (change == AT_END) arc(r, r.command.length, r.command.turn);
      if (loop >= 0) {
        const Bits done = load<Bits>(&seeds.times[(size_t(loop) * N + i) * LANES]) <= limit;
        const Command &sent = ring[newest * N + i];
        r.command = {done ? sent.length : r.command.length, done ? sent.turn : r.command.turn};
        r.born = done ? fill(float(loop)) : r.born;
      }
      if (change == INSIDE) arc(r, r.command.length * (1 - part), r.command.turn * (1 - part));
      if (change == AT_BEGINNING) arc(r, r.command.length, r.command.turn);
    }
  }
  for (int i = 0; i < N; ++i) {
    tally(robots[i], seeds.offset, load<Vec>(&seeds.share[size_t(work.ticks) * LANES]), 0.5f);
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
