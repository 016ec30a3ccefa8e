/* The predictor of servobench.identification.models.from_rest as a C programmer writes it, for bench/identification_speed.py:
 * residual, sensitivities and normal equations of a motor from rest in one pass, and the fit of its three parameters by Gauss and
 * Newton. p are gain, time constant and start position; h and g are J'J, row by row, and J'r. */

#include <math.h>
#include <stdint.h>

double normal_equations(const double *restrict u, const double *restrict y, double step, int64_t n, const double *restrict p,
                        double *restrict h, double *restrict g)
{
    const double gain = p[0], tau = p[1], position = p[2];
    const double b = -expm1(-step / tau), a = 1.0 - b, by_speed = tau * b, by_input = step - by_speed;
    const double da = a * step / (tau * tau), dg = b - tau * da;
    double w = 0.0, th = 0.0, wt = 0.0, tt = 0.0;
    double rr = 0.0, thth = 0.0, thtt = 0.0, tttt = 0.0, sth = 0.0, stt = 0.0, thr = 0.0, ttr = 0.0, sr = 0.0;
    for (int64_t k = 0; k < n; k++) {
        const double r = (y[k] - position) - gain * th;
        rr += r * r;
        thth += th * th;
        thtt += th * tt;
        tttt += tt * tt;
        sth += th;
        stt += tt;
        thr += th * r;
        ttr += tt * r;
        sr += r;
        const double v = u[k], e = w - v;
        tt += by_speed * wt + dg * e;
        wt = a * wt + da * e;
        th += by_speed * w + by_input * v;
        w = a * w + b * v;
    }
    h[0] = thth;
    h[4] = gain * gain * tttt;
    h[8] = (double)n;
    h[1] = h[3] = gain * thtt;
    h[2] = h[6] = sth;
    h[5] = h[7] = gain * stt;
    g[0] = thr;
    g[1] = gain * ttr;
    g[2] = sr;
    return rr;
}

static int64_t settle(const double *restrict u, const double *restrict y, double step, int64_t n, double *restrict p, int64_t most,
                      double settled)
{
    double h[9], g[3];
    for (int64_t k = 0; k < most; k++) {
        normal_equations(u, y, step, n, p, h, g);
        const double l00 = sqrt(h[0]), l10 = h[3] / l00, l20 = h[6] / l00;
        const double l11 = sqrt(h[4] - l10 * l10), l21 = (h[7] - l20 * l10) / l11;
        const double l22 = sqrt(h[8] - l20 * l20 - l21 * l21);
        const double z0 = g[0] / l00, z1 = (g[1] - l10 * z0) / l11, z2 = (g[2] - l20 * z0 - l21 * z1) / l22;
        const double position = z2 / l22, slower = (z1 - l21 * position) / l11;
        const double gain = (z0 - l10 * slower - l20 * position) / l00;
        const double tau = fmax(p[1] + slower, step) - p[1];
        p[0] += gain;
        p[1] += tau;
        p[2] += position;
        if (fabs(gain) < settled * fabs(p[0]) && fabs(tau) < settled * p[1])
            return k + 1;
    }
    return -1;
}

/* The first eighth of the samples leads nearly there; where it doesn't, the search begins again with all of them. */
int64_t fit_from_rest(const double *restrict u, const double *restrict y, double step, int64_t n, double *restrict p, int64_t most)
{
    const double start[3] = {p[0], p[1], p[2]};
    if (n >= 8 && settle(u, y, step, n / 8, p, most, 0.03) > 0) {
        const int64_t passes = settle(u, y, step, n, p, most, 1e-5);
        if (passes > 0)
            return passes;
    }
    for (int k = 0; k < 3; k++)
        p[k] = start[k];
    return settle(u, y, step, n, p, most, 1e-5);
}
