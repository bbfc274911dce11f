/* The pipeline in one fused pass per sweep, OpenMP over logs; compiled and called by c_peers.py.
 *
 * Loops that a compiler can vectorise, blocks of sweeps whose intermediate results stay in the first-level cache,
 * nothing allocated, the number of bins known when compiled (-DBINS=128). No compiler vectorises an arg-max well, so
 * that one is written by hand where there is AVX-512: three times as fast as the loops below it (22 against 7 ms for
 * 1,024,000 sweeps on two cores).
 */
#include <math.h>
#include <stdint.h>
#include <string.h>
#ifdef __AVX512BW__
#include <immintrin.h>
#endif

#define LANES 16 /* floats in one AVX-512 register; narrower machines split it */
#define BLOCK 80 /* sweeps whose selected taps are refined together */
#define TAPS 9

static const float SHARPNESS = 10.0f * 1.442695041f; /* 1 / temperature, for powers of two */

/* 2^x for -100 < x <= 0 to 2e-7: Taylor's polynomial of degree 6 between -1/2 and 1/2, the whole part put into the
 * exponent. libm's vector form looks after infinities and denormal numbers, which cost half as much again. */
static inline float power_of_two(float x) {
  float whole = rintf(x), rest = x - whole;
  float sum = 1.5403530e-4f;
  sum = sum * rest + 1.3333558e-3f;
  sum = sum * rest + 9.6181291e-3f;
  sum = sum * rest + 5.5504109e-2f;
  sum = sum * rest + 2.4022651e-1f;
  sum = sum * rest + 6.9314718e-1f;
  sum = sum * rest + 1.0f;
  int32_t bits;
  memcpy(&bits, &sum, sizeof bits);
  bits += (int32_t)whole << 23;
  memcpy(&sum, &bits, sizeof bits);
  return sum;
}

/* First of the largest a*w, exact. */
#if defined(__AVX512BW__) && BINS % 64 == 0
/* The products stay in registers; one bit for each bin that equals the largest, and the lowest bit is the first. */
static inline int select_bin(const uint16_t *restrict a, const float *restrict w) {
  __m512 value[BINS / LANES], best = _mm512_setzero_ps();
#pragma GCC unroll 64
  for (int row = 0; row < BINS / LANES; row++) {
    __m512i counts = _mm512_cvtepu16_epi32(_mm256_loadu_si256((const __m256i *)(a + row * LANES)));
    value[row] = _mm512_mul_ps(_mm512_cvtepi32_ps(counts), _mm512_loadu_ps(w + row * LANES));
    best = _mm512_max_ps(best, value[row]);
  }
  __m512 top = _mm512_set1_ps(_mm512_reduce_max_ps(best));
  int first = 0;
#pragma GCC unroll 16
  for (int word = BINS / 64 - 1; word >= 0; word--) {
    uint64_t equal = 0;
#pragma GCC unroll 4
    for (int row = 0; row < 4; row++)
      equal |= (uint64_t)_mm512_cmp_ps_mask(value[word * 4 + row], top, _CMP_EQ_OQ) << (LANES * row);
    first = equal ? 64 * word + __builtin_ctzll(equal) : first;
  }
  return first;
}
#else
static inline int select_bin(const uint16_t *restrict a, const float *restrict w) {
  float value[BINS], top = 0.0f;
  for (int bin = 0; bin < BINS; bin++) {
    value[bin] = (float)(int32_t)a[bin] * w[bin];
    top = value[bin] > top ? value[bin] : top;
  }
  int first = BINS;
  for (int bin = 0; bin < BINS; bin++) {
    int candidate = value[bin] == top ? bin : BINS;
    first = candidate < first ? candidate : first;
  }
  return first;
}
#endif

/* |difference| / dt over the threshold; `distance` holds positions in bins on entry and metres on return. */
static inline void decide(float *restrict distance, const float *restrict dt, float *restrict speed,
                          uint8_t *restrict event, long sweeps, float start_m, float bin_m, float threshold) {
  for (long s = 0; s < sweeps; s++) distance[s] = start_m + bin_m * distance[s];
  speed[0] = 0.0f;
  event[0] = 0;
  for (long s = 1; s < sweeps; s++) {
    float rate = (distance[s] - distance[s - 1]) / dt[s];
    speed[s] = rate;
    event[s] = fabsf(rate) > threshold;
  }
}

#define PIPELINE(NAME, LOCATE)                                                                                       \
  void NAME(const uint16_t *a, const float *w, const float *dt, float *distance, float *speed, uint8_t *event,       \
            long logs, long sweeps, float start_m, float bin_m, float threshold) {                                   \
    _Pragma("omp parallel for schedule(dynamic, 1)") for (long log = 0; log < logs; log++) {                         \
      long at = log * sweeps;                                                                                        \
      LOCATE(a + at * BINS, w, distance + at, sweeps);                                                               \
      decide(distance + at, dt + at, speed + at, event + at, sweeps, start_m, bin_m, threshold);                     \
    }                                                                                                                \
  }

static void locate_argmax(const uint16_t *a, const float *w, float *position, long sweeps) {
  for (long s = 0; s < sweeps; s++) position[s] = (float)select_bin(a + s * BINS, w);
}

static void locate_parabola(const uint16_t *a, const float *w, float *position, long sweeps) {
  float left[BLOCK], middle[BLOCK], right[BLOCK], centre[BLOCK], selected[BLOCK];
  for (long done = 0; done < sweeps; done += BLOCK) {
    int count = sweeps - done < BLOCK ? (int)(sweeps - done) : BLOCK;
    for (int s = 0; s < count; s++) {
      const uint16_t *sweep = a + (done + s) * BINS;
      int bin = select_bin(sweep, w);
      selected[s] = (float)bin;
      bin = bin < 1 ? 1 : bin > BINS - 2 ? BINS - 2 : bin;
      left[s] = sweep[bin - 1], middle[s] = sweep[bin], right[s] = sweep[bin + 1], centre[s] = (float)bin;
    }
    for (int s = 0; s < count; s++) {
      float curvature = left[s] - 2.0f * middle[s] + right[s];
      float offset = 0.5f * (left[s] - right[s]) / (curvature < 0.0f ? curvature : -1.0f);
      int inside = (curvature < 0.0f) & (fabsf(offset) <= 1.0f);
      position[done + s] = inside ? centre[s] + offset : selected[s];
    }
  }
}

static void locate_window(const uint16_t *a, const float *w, float *position, long sweeps) {
  float taps[TAPS][BLOCK], start[BLOCK];
  for (long done = 0; done < sweeps; done += BLOCK) {
    int count = sweeps - done < BLOCK ? (int)(sweeps - done) : BLOCK;
    for (int s = 0; s < count; s++) {
      const uint16_t *sweep = a + (done + s) * BINS;
      int first = select_bin(sweep, w) - TAPS / 2;
      first = first < 0 ? 0 : first > BINS - TAPS ? BINS - TAPS : first;
      for (int tap = 0; tap < TAPS; tap++) taps[tap][s] = sweep[first + tap];
      start[s] = (float)first;
    }
    for (int s = 0; s < count; s++) {
      float top = taps[0][s], total = 0.0f, moment = 0.0f;
      for (int tap = 1; tap < TAPS; tap++) top = taps[tap][s] > top ? taps[tap][s] : top;
      float scale = SHARPNESS / top;
      for (int tap = 0; tap < TAPS; tap++) {
        float weight = power_of_two(taps[tap][s] * scale - SHARPNESS);
        total += weight;
        moment += weight * (float)tap;
      }
      position[done + s] = start[s] + moment / total;
    }
  }
}

static void locate_soft(const uint16_t *a, const float *w, float *position, long sweeps) {
  float compensated[BINS] __attribute__((aligned(64)));
  for (long s = 0; s < sweeps; s++) {
    const uint16_t *sweep = a + s * BINS;
    float top = 0.0f, total = 0.0f, moment = 0.0f;
    for (int bin = 0; bin < BINS; bin++) {
      compensated[bin] = (float)(int32_t)sweep[bin] * w[bin];
      top = compensated[bin] > top ? compensated[bin] : top;
    }
    float scale = SHARPNESS / top;
    for (int bin = 0; bin < BINS; bin++) {
      float weight = power_of_two(compensated[bin] * scale - SHARPNESS);
      total += weight;
      moment += weight * (float)bin;
    }
    position[s] = moment / total;
  }
}

PIPELINE(pipeline_argmax, locate_argmax)
PIPELINE(pipeline_parabola, locate_parabola)
PIPELINE(pipeline_window, locate_window)
PIPELINE(pipeline_soft, locate_soft)

/* How fast the machine reads: the sum of all words, by all threads. */
uint64_t read_all(const uint64_t *words, long count) {
  uint64_t total = 0;
#pragma omp parallel for simd reduction(+ : total) schedule(static)
  for (long i = 0; i < count; i++) total += words[i];
  return total;
}
