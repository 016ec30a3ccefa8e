/* The twin as a C programmer writes it, for bench/speed.py: one tick exact for a held voltage and a held friction, saturation,
 * Coulomb friction as the impulse that takes the speed to rest or as much as it can (Moreau), an encoder that wraps at 16 bits.
 *
 * c are the coefficients of servobench.rig.motor.solvers.exact, from A00 on: a00 a01 b0 a10 a11 b1 t0 t1 tb c1 g q.
 * Each stores current, speed and counts of every tick. */

#include <math.h>
#include <stdint.h>

static double clip(double x, double most) { return fmax(-most, fmin(most, x)); }

void textbook(const double *restrict c, double limit, double scale, int64_t n, const double *restrict u,
              double *restrict current, double *restrict speed, int16_t *restrict counts)
{
    double i = 0.0, w = 0.0, theta = 0.0;
    for (int64_t k = 0; k < n; k++) {
        const double v = clip(u[k], limit);
        const double free = c[3] * i + c[4] * w + c[5] * v;
        const double d = clip(free, c[9]);
        theta += c[6] * i + c[7] * w + c[8] * v - c[11] * d;
        i = c[0] * i + c[1] * w + c[2] * v + c[10] * d;
        w = free - d;
        current[k] = i;
        speed[k] = w;
        counts[k] = (int16_t)(int64_t)floor(theta * scale);
    }
}

/* The same with what friction adds taken out of the state: s = A x + B v, so that the outputs and the next prediction don't wait
 * for each other, and the impulse d comes in last. */
void free_state(const double *restrict c, double limit, double scale, int64_t n, const double *restrict u,
                double *restrict current, double *restrict speed, int16_t *restrict counts)
{
    const double a00 = c[0], a01 = c[1], b0 = c[2], a10 = c[3], a11 = c[4], b1 = c[5];
    const double t0 = c[6], t1 = c[7], tb = c[8], c1 = c[9], g = c[10], q = c[11];
    const double by_current = a00 * g - a01, by_speed = a10 * g - a11;
    double i = 0.0, w = 0.0, theta = 0.0, v = clip(u[0], limit);
    double si = b0 * v, sw = b1 * v;
    for (int64_t k = 0; k < n; k++) {
        const double d = clip(sw, c1);
        theta = ((theta + t0 * i) + (t1 * w + tb * v)) - q * d;
        i = si + g * d;
        w = sw - d;
        current[k] = i;
        speed[k] = w;
        counts[k] = (int16_t)(int64_t)floor(theta * scale);
        v = clip(u[k + 1 < n ? k + 1 : k], limit);
        const double next = ((b1 * v + a10 * si) + a11 * sw) + by_speed * d;
        si = ((b0 * v + a00 * si) + a01 * sw) + by_current * d;
        sw = next;
    }
}
