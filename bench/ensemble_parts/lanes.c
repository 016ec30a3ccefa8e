/* An ensemble as a C programmer writes it who counts registers, for bench/ensemble.py: sixteen motors side by side, a block of
 * sixteen through all ticks before the next. One tick is exact for a held voltage and a held friction; saturation, Coulomb friction
 * as the impulse that takes the speed to rest or as much as it can (Moreau), an encoder that wraps at 16 bits.
 *
 * c[14][motors] are a00 a01 b0 a10 a11 b1 t0 t1 tb c1 g q limit scale, as in servobench.rig.ensemble.kernels;
 * counts[block][tick][16]; state[3][motors] gets current, speed and angle at the end. */

#include <math.h>
#include <stdint.h>

#define ROWS 14

#if defined(__AVX512F__) && defined(__AVX512VL__)

#include <immintrin.h>

typedef __m512d lanes;
const int registers_by_hand = 1;

static inline lanes clip(lanes x, lanes most)
{
    return _mm512_max_pd(_mm512_sub_pd(_mm512_setzero_pd(), most), _mm512_min_pd(x, most));
}

#define MUL(a, b) _mm512_mul_pd(a, b)
#define FMA(a, b, c) _mm512_fmadd_pd(a, b, c)

static inline void simulate(const double *restrict c, const double *restrict u, int64_t ticks, int64_t motors, int64_t first,
                            int64_t last, double *restrict state, int16_t *restrict counts, const int keep)
{
    for (int64_t b = first; b < last; b++) {
        lanes p[ROWS][2], i[2], w[2], theta[2];
        for (int r = 0; r < ROWS; r++)
            for (int h = 0; h < 2; h++)
                p[r][h] = _mm512_loadu_pd(c + r * motors + b * 16 + 8 * h);
        for (int h = 0; h < 2; h++)
            i[h] = w[h] = theta[h] = _mm512_setzero_pd();
        for (int64_t t = 0; t < ticks; t++) {
            const lanes given = _mm512_set1_pd(u[t]);
            for (int h = 0; h < 2; h++) {
                if (keep) {
                    const lanes turned = _mm512_roundscale_pd(MUL(theta[h], p[13][h]), _MM_FROUND_TO_NEG_INF | _MM_FROUND_NO_EXC);
                    _mm_storeu_si128((__m128i *)(counts + (b * ticks + t) * 16 + 8 * h),
                                     _mm256_cvtepi32_epi16(_mm512_cvttpd_epi32(turned)));
                }
                const lanes v = clip(given, p[12][h]);
                const lanes free = FMA(p[4][h], w[h], FMA(p[3][h], i[h], MUL(p[5][h], v)));
                const lanes d = clip(free, p[9][h]);
                theta[h] = _mm512_add_pd(theta[h], _mm512_add_pd(FMA(p[6][h], i[h], MUL(p[8][h], v)),
                                                                 _mm512_fnmadd_pd(p[11][h], d, MUL(p[7][h], w[h]))));
                i[h] = FMA(p[10][h], d, FMA(p[1][h], w[h], FMA(p[0][h], i[h], MUL(p[2][h], v))));
                w[h] = _mm512_sub_pd(free, d);
            }
        }
        for (int h = 0; h < 2; h++) {
            _mm512_storeu_pd(state + b * 16 + 8 * h, i[h]);
            _mm512_storeu_pd(state + motors + b * 16 + 8 * h, w[h]);
            _mm512_storeu_pd(state + 2 * motors + b * 16 + 8 * h, theta[h]);
        }
    }
}

#else /* the compiler's own vectors, however wide they are here */

#define LANES for (int j = 0; j < 16; j++)
const int registers_by_hand = 0;

static inline double clip(double x, double most)
{
    const double below = x < most ? x : most;
    return below > -most ? below : -most;
}

static inline void simulate(const double *restrict c, const double *restrict u, int64_t ticks, int64_t motors, int64_t first,
                            int64_t last, double *restrict state, int16_t *restrict counts, const int keep)
{
    for (int64_t b = first; b < last; b++) {
        double p[ROWS][16] __attribute__((aligned(64)));
        double i[16] __attribute__((aligned(64))) = {0}, w[16] __attribute__((aligned(64))) = {0};
        double theta[16] __attribute__((aligned(64))) = {0};
        for (int r = 0; r < ROWS; r++)
            LANES p[r][j] = c[r * motors + b * 16 + j];
        for (int64_t t = 0; t < ticks; t++)
            LANES {
                if (keep)
                    counts[(b * ticks + t) * 16 + j] = (int16_t)(int32_t)floor(theta[j] * p[13][j]);
                const double v = clip(u[t], p[12][j]), current = i[j], speed = w[j];
                const double free = p[3][j] * current + p[4][j] * speed + p[5][j] * v;
                const double d = clip(free, p[9][j]);
                theta[j] += (p[6][j] * current + p[8][j] * v) + (p[7][j] * speed - p[11][j] * d);
                w[j] = free - d;
                i[j] = p[0][j] * current + p[1][j] * speed + p[2][j] * v + p[10][j] * d;
            }
        LANES {
            state[b * 16 + j] = i[j];
            state[motors + b * 16 + j] = w[j];
            state[2 * motors + b * 16 + j] = theta[j];
        }
    }
}

#endif

void states_only(const double *c, const double *u, int64_t ticks, int64_t motors, int64_t first, int64_t last, double *state,
                 int16_t *counts)
{
    simulate(c, u, ticks, motors, first, last, state, counts, 0);
}

void with_counts(const double *c, const double *u, int64_t ticks, int64_t motors, int64_t first, int64_t last, double *state,
                 int16_t *counts)
{
    simulate(c, u, ticks, motors, first, last, state, counts, 1);
}
