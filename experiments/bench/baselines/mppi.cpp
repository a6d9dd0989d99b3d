// One cycle of MPPI on vectors of rollouts, for mppi_cpp.py (model, section 9): noise, rollouts within the limits on
// acceleration, critics, weights and the averaged sequence.
//
// A vector of rollouts goes through all its steps in registers; only its samples are kept, for the average, and four
// numbers per rollout, for the critics that need all ends.
#include <cmath>
#include <cstdint>
#include <vector>
#if defined(__AVX512F__)
#include <immintrin.h>
#define LANES 16
#else
#define LANES 8
#endif

namespace {

typedef float Vec __attribute__((vector_size(4 * LANES)));
typedef std::int32_t Int __attribute__((vector_size(4 * LANES)));
typedef std::uint32_t Word __attribute__((vector_size(4 * LANES)));

inline Vec fill(float a) { return a - Vec{}; }
inline Vec larger(Vec a, Vec b) { return a > b ? a : b; }
inline Vec smaller(Vec a, Vec b) { return a < b ? a : b; }
inline Vec magnitude(Vec a) { return (Vec)((Int)a & INT32_MAX); }
inline Vec whole(Int a) { return __builtin_convertvector(a, Vec); }
inline Int cut(Vec a) { return __builtin_convertvector(a, Int); }  // towards zero
inline Vec load(const float *from) { return *(const Vec *)from; }
inline void store(float *to, Vec a) { *(Vec *)to = a; }

inline Vec root(Vec a) {
#if defined(__AVX512F__)
  return (Vec)_mm512_sqrt_ps((__m512)a);
#else
  for (int l = 0; l < LANES; ++l) a[l] = std::sqrt(a[l]);
  return a;
#endif
}

inline Vec down(Vec a) {
#if defined(__AVX512F__)
  return (Vec)_mm512_roundscale_ps((__m512)a, _MM_FROUND_TO_NEG_INF | _MM_FROUND_NO_EXC);
#else
  for (int l = 0; l < LANES; ++l) a[l] = std::floor(a[l]);
  return a;
#endif
}

inline Vec gather(const float *from, Int at) {
#if defined(__AVX512F__)
  return (Vec)_mm512_i32gather_ps((__m512i)at, from, 4);
#else
  Vec found;
  for (int l = 0; l < LANES; ++l) found[l] = from[at[l]];
  return found;
#endif
}

// Natural logarithm of a > 0: exponent and mantissa apart, a polynomial in the mantissa on [√½, √2).
inline Vec logarithm(Vec a) {
  const Int shifted = (Int)a - 0x3f3504f3;  // √½
  const Vec f = (Vec)((shifted & 0x7fffff) + 0x3f3504f3) - 1.0f, e = whole(shifted >> 23);
  Vec p = fill(7.0376836e-2f);
  for (float c : {-1.1514610e-1f, 1.1676999e-1f, -1.2420141e-1f, 1.4249323e-1f, -1.6668058e-1f, 2.0000715e-1f,
                  -2.4999994e-1f, 3.3333331e-1f})
    p = p * f + c;
  return e * 0.693147181f + (f + f * f * (p * f - 0.5f));
}

// exp(a) for a <= 0: 2^n times a polynomial on [-ln 2 / 2, ln 2 / 2].
inline Vec exponential(Vec a) {
  a = larger(a, fill(-87.0f));
  const Vec n = down(a * 1.44269504f + 0.5f), r = a - n * 0.693145752f - n * 1.42860677e-6f;
  Vec p = fill(1.3888889e-3f);
  for (float c : {8.3333333e-3f, 4.1666667e-2f, 1.6666667e-1f, 0.5f, 1.0f, 1.0f}) p = p * r + c;
  return (Vec)((Int)p + (cut(n) << 23));
}

// sin(a)/a and cos(a), up to 1 rad.
inline void sinc_cos(Vec a, Vec &sinc, Vec &cos) {
  const Vec q = a * a;
  sinc = 1 - q / 6 * (1 - q / 20 * (1 - q / 42 * (1 - q / 72)));
  cos = 1 - q / 2 * (1 - q / 12 * (1 - q / 30 * (1 - q / 56 * (1 - q / 90))));
}

inline Word turned(Word a, int by) { return (a << by) | (a >> (32 - by)); }

}  // namespace

extern "C" {

struct Cycle {
  std::int32_t samples, steps, rows, cols, points, last, cost_step, align_step, goal_on, angle_on, soft_on;
  std::int32_t align_from, follow_offset;
  std::uint32_t seed[2];  // of the noise
  float dt, v_min, v_max, rise, fall, turn, resolution, spacing;
  float constraint, forward, critical, near_collision, collision, cost, to_goal, angle, align, follow;  // of sums
  float temperature, occupancy;
  float pose[3], goal[3], now[2], std[2], control[2], origin[2];  // control: γ/σ²
  const float *mean_v, *mean_w, *cells, *path_x, *path_y, *clear;
  float *drawn_v, *drawn_w, *total, *weight, *out_v, *out_w, *work;
};

int lanes() { return LANES; }

}  // extern "C"

namespace {

// Threefry-2x32 of counters (step, rollout), then the transform of Box and Muller.
inline void normal(const Cycle &c, int step, Word column, Vec &first, Vec &second) {
  const std::uint32_t keys[3] = {c.seed[0], c.seed[1], c.seed[0] ^ c.seed[1] ^ 0x1BD11BDAu};
  const int turns[8] = {13, 15, 26, 6, 17, 29, 16, 24};
  Word x = Word{} + (keys[0] + step), y = column + keys[1];
#pragma GCC unroll 20
  for (int i = 0; i < ROUNDS; ++i) {
    x += y;
    y = turned(y, turns[i % 8]) ^ x;
    if (i % 4 == 3) {
      const int n = i / 4 + 1;
      x += keys[n % 3], y += keys[(n + 1) % 3] + n;
    }
  }
  const Vec u = (whole((Int)(x >> 9)) + 0.5f) * 0x1p-23f;
  const Vec a = ((whole((Int)(y >> 9)) + 0.5f) * 0x1p-23f - 0.5f) * 1.57079633f;
  const Vec radius = root(-2.0f * logarithm(u));
  Vec sinc, cos;
  sinc_cos(a, sinc, cos);
  Vec along = cos * radius;
  along = (y & 1) != 0 ? along : -along;
  const Vec across = sinc * a * radius;
  first = (y & 2) != 0 ? across : along;
  second = (y & 2) != 0 ? along : across;
}

inline Vec cell_cost(const Cycle &c, Vec x, Vec y) {
  const Vec row = down((y - c.origin[1]) / c.resolution), col = down((x - c.origin[0]) / c.resolution);
  const Int inside = (row >= 0.0f) & (row < (float)c.rows) & (col >= 0.0f) & (col < (float)c.cols);
  const Int at = inside & (cut(row) * c.cols + cut(col));
  return inside ? gather(c.cells, at) : fill(255.0f);
}

// Draws the samples of the rollouts from k on; returns the control cost.
inline Vec draw(const Cycle &c, int k) {
  Word column = Word{} + (std::uint32_t)k;
  for (int l = 0; l < LANES; ++l) column[l] += l;
  Vec control{};
#pragma GCC unroll 2
  for (int i = 0; i < c.steps; ++i) {
    Vec first, second;
    normal(c, i, column, first, second);
    const Vec noise_v = c.std[0] * first, noise_w = c.std[1] * second;
    store(c.drawn_v + k * c.steps + i * LANES, c.mean_v[i] + noise_v);
    store(c.drawn_w + k * c.steps + i * LANES, c.mean_w[i] + noise_w);
    control += c.control[0] * c.mean_v[i] * noise_v + c.control[1] * c.mean_w[i] * noise_w;
  }
  return control;
}

// Draws, moves and scores the rollouts from k on. Keeps their ends, the way they went and the sums of PathAlign.
void roll(const Cycle &c, int k) {
  const int K = c.samples;
  Vec control = draw(c, k);
  Vec x = fill(c.pose[0]), y = fill(c.pose[1]), heading = fill(c.pose[2]);
  Vec cos = fill(std::cos(c.pose[2])), sin = fill(std::sin(c.pose[2]));
  Vec v = fill(c.now[0]), w = fill(c.now[1]), wanted_v = v, wanted_w = w;
  Vec way = fill(-std::abs(c.now[0]) * c.dt), chord_x{}, chord_y{}, chords{}, gaps{}, used{};
  Vec over{}, back{}, cells{}, near{}, angles{};
  Int hit = Int{};
  for (int i = 0; i < c.steps; ++i) {
    const float up = c.rise, down_ = c.fall;
    v = smaller(larger(wanted_v, v - (v > 0.0f ? fill(down_) : fill(up))), v + (v > 0.0f ? fill(up) : fill(down_)));
    w = smaller(larger(wanted_w, w - c.turn), w + c.turn);
    way += magnitude(v) * c.dt;

    const Vec a = w * (0.5f * c.dt);
    Vec sinc, cos_a;
    const Vec q = a * a;  // up to 0.14 rad: a short series
    sinc = 1 - q / 6 * (1 - q / 20), cos_a = 1 - q / 2 * (1 - q / 12 * (1 - q / 30));
    const Vec sin_a = a * sinc, cos_mid = cos * cos_a - sin * sin_a, sin_mid = sin * cos_a + cos * sin_a;
    const Vec chord = v * c.dt * sinc;
    x += chord * cos_mid, y += chord * sin_mid, heading += 2.0f * a;
    cos = cos_mid * cos_a - sin_mid * sin_a, sin = sin_mid * cos_a + cos_mid * sin_a;

    over += larger(v - c.v_max, Vec{}) + larger(c.v_min - v, Vec{});
    back += larger(-v, Vec{});
    if (i % c.cost_step == 0) {
      const Vec cost = cell_cost(c, x, y);
      hit |= cost >= 253.0f;
      cells += cost >= c.near_collision ? fill(c.critical) : c.soft_on ? cost : Vec{};
    }
    if (c.goal_on) near += root((x - c.goal[0]) * (x - c.goal[0]) + (y - c.goal[1]) * (y - c.goal[1]));
    if (c.angle_on) {
      const Vec turn = (heading - c.goal[2]) * 0.159154943f;
      angles += magnitude(turn - down(turn + 0.5f)) * 6.28318531f;
    }
    if (i % c.align_step == 0) {
      if (i) {
        chords += root((x - chord_x) * (x - chord_x) + (y - chord_y) * (y - chord_y));
        const Int at = cut(smaller(chords / c.spacing + 0.5f, fill((float)c.last)));
        const Vec gap_x = gather(c.path_x, at) - x, gap_y = gather(c.path_y, at) - y, clear = gather(c.clear, at);
        gaps += root(gap_x * gap_x + gap_y * gap_y) * clear, used += clear;
      }
      chord_x = x, chord_y = y;
    }

    wanted_v = load(c.drawn_v + k * c.steps + i * LANES), wanted_w = load(c.drawn_w + k * c.steps + i * LANES);
  }
  const Vec own = c.constraint * over + c.forward * back + c.to_goal * near + c.angle * angles;
  store(c.total + k, own + control + c.cost * (hit ? fill(c.collision) : cells));
  const Vec ends[4] = {x, y, way, gaps / larger(used, fill(1.0f))};
  for (int j = 0; j < 4; ++j) store(c.work + j * K + k, ends[j]);
}

// Largest index of a path point that is the nearest one to an end, no further along than that rollout has travelled.
int furthest(const Cycle &c) {
  Int most = Int{};
  for (int k = 0; k < c.samples; k += LANES) {
    const Vec x = load(c.work + k), y = load(c.work + c.samples + k);
    const Vec reach = -down(-load(c.work + 2 * c.samples + k) / c.spacing);
    Vec least = fill(INFINITY);
    Int nearest = Int{};
    for (int m = 0; m < c.points; ++m) {
      const Vec gap_x = x - c.path_x[m], gap_y = y - c.path_y[m], squared = gap_x * gap_x + gap_y * gap_y;
      const Int better = (squared < least) & (reach >= (float)m);
      least = better ? squared : least;
      nearest = better ? Int{} + m : nearest;
    }
    most = nearest > most ? nearest : most;
  }
  int largest = 0;
  for (int l = 0; l < LANES; ++l) largest = most[l] > largest ? most[l] : largest;
  return largest;
}

// Adds what hangs on the furthest point reached.
void add_path_critics(const Cycle &c, int reached) {
  int blocked = 0, target = c.last;
  for (int m = 0; m < reached && m < c.points; ++m) blocked += c.clear[m] == 0.0f;
  for (int m = c.last - 1; m >= reached + c.follow_offset; --m) target = c.clear[m] > 0.0f ? m : target;
  const bool aligns = (blocked <= 2 || blocked <= c.occupancy * reached) && reached >= c.align_from;
  const float align = aligns ? c.align : 0.0f;
  for (int k = 0; k < c.samples; k += LANES) {
    const Vec gap_x = load(c.work + k) - c.path_x[target], gap_y = load(c.work + c.samples + k) - c.path_y[target];
    const Vec path = align * load(c.work + 3 * c.samples + k) + c.follow * root(gap_x * gap_x + gap_y * gap_y);
    store(c.total + k, load(c.total + k) + path);
  }
}

float sum(Vec a) {
  float total = 0.0f;
  for (int l = 0; l < LANES; ++l) total += a[l];
  return total;
}

void average(const Cycle &c) {
  Vec lowest = fill(INFINITY), sums = Vec{};
  for (int k = 0; k < c.samples; k += LANES) lowest = smaller(lowest, load(c.total + k));
  float least = lowest[0];
  for (int l = 1; l < LANES; ++l) least = lowest[l] < least ? lowest[l] : least;
  for (int k = 0; k < c.samples; k += LANES) {
    const Vec weight = exponential((least - load(c.total + k)) / c.temperature);
    store(c.weight + k, weight);
    sums += weight;
  }
  const float scale = 1.0f / sum(sums);
  std::vector<float> room(2 * c.steps * LANES + LANES);
  float *v = (float *)(((std::uintptr_t)room.data() + 4 * LANES - 1) / (4 * LANES) * (4 * LANES)), *w = v + c.steps * LANES;
  for (int k = 0; k < c.samples; k += LANES) {
    const Vec weight = load(c.weight + k);
    for (int i = 0; i < c.steps * LANES; i += LANES) {
      store(v + i, load(v + i) + weight * load(c.drawn_v + k * c.steps + i));
      store(w + i, load(w + i) + weight * load(c.drawn_w + k * c.steps + i));
    }
  }
  for (int i = 0; i < c.steps; ++i)
    c.out_v[i] = scale * sum(load(v + i * LANES)), c.out_w[i] = scale * sum(load(w + i * LANES));
}

}  // namespace

// The rollouts are a multiple of the lanes, and the arrays begin at multiples of 64 bytes.
extern "C" void cycle(const Cycle *given) {
  const Cycle c = *given;
  for (int k = 0; k < c.samples; k += LANES) roll(c, k);
  add_path_critics(c, furthest(c));
  average(c);
}
